"""What docs/prototypes.md, its data and README.md say of the runs on the paper's prototypes, from these runs.

All three seeds of a run are above all three of an equal one by chance once in 20.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from helpers import ROOT

from ibdata.evaluation.baselines import PROTOTYPES, shipped_baselines
from training import formulas, setpoint_map
from training import prototypes_page as page
from training.plan import BLIND, BLIND_FEW, FOUR, SIZES, SOURCES, TARGETS, episodes_each, part, transfer
from training.protocol import EVALUATIONS, TEN
from training.results import Results, difference, means, number
from training.selection import rank_correlation

RESULTS = Results(shipped_baselines([PROTOTYPES]))
MEASURED = json.loads((ROOT / "docs/prototypes.json").read_text(encoding="utf-8"))
FEW, MIDDLE, MANY = (episodes_each(count) for count in SIZES["random"])
START, AROUND, LONG = page.COLUMNS
ALL = [*FOUR, "cql"]
TRAINED = [(name, *pair) for name in SIZES for pair in page.learned_parts(RESULTS, name)]
ABOUT = page.ABOUT
TEXT = " ".join((ROOT / "docs/prototypes.md").read_text(encoding="utf-8").split())


def of(name, data, algorithm, column):
    """The mean return of each seed."""
    settings, by = page.COLUMNS[column]
    return means(RESULTS.returns(name, data, algorithm, settings), by)


def known(name, policy, column):
    settings, by = page.COLUMNS[column]
    return RESULTS.known(name, policy, settings).mean() / by


def at_75(data, algorithm):
    """The mean return of each seed in the transfer."""
    return means(RESULTS.returns("transfer", data, algorithm, EVALUATIONS["transfer"][0]))


def above(better, worse):
    """Whether every seed of a run is above every seed of another."""
    return min(better) > max(worse)


def differences(data, algorithm, column):
    """The differences of each seed from the safe behaviour."""
    settings, by = page.COLUMNS[column]
    base = RESULTS.known("safe", "behaviour", settings)
    return [difference([x], base, by) for x in RESULTS.returns("safe", data, algorithm, settings)]


def test_no_run_reaches_optimized():
    for column in page.COLUMNS:
        assert all(max(of(*run, column)) < known("random", "optimized", column) for run in TRAINED)
    random = [run for run in TRAINED if run[0] == "random"]
    assert max(random, key=lambda run: max(of(*run, START))) == ("random", FEW, "iql")
    assert max(random, key=lambda run: np.mean(of(*run, START))) == ("random", MIDDLE, "cql")


def test_the_readme_has_the_best_from_as_many_transitions():
    best = [max((np.mean(of(name, MIDDLE, x, START)), x) for x in ALL) for name in ("random", "safe")]
    assert [name for _, name in best] == ["cql", "iql"]
    random, safe, optimized = (
        number(x) for x in (*(x for x, _ in best), known("random", "optimized", START))
    )
    said = (
        f"gets {random} from 10⁵ random transitions (CQL, one seed) and {safe} from safe ones (IQL, three); "
    )
    text = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    assert f"{said}a formula gets {optimized}." in text


def test_where_more_data_help():
    def gained(fewer, more):
        pairs = [(x, column) for x in FOUR for column in page.COLUMNS]
        return {(x, c) for x, c in pairs if above(of("random", more, x, c), of("random", fewer, x, c))}

    over_100 = {("td3+bc", AROUND), ("model-based", AROUND)}
    assert gained(FEW, MIDDLE) == {*over_100, *((x, LONG) for x in FOUR)}
    assert gained(MIDDLE, MANY) == {("bc", START), ("bc", AROUND)}
    gains = [np.mean(of("random", MIDDLE, x, LONG)) - np.mean(of("random", FEW, x, LONG)) for x in FOUR]
    assert f"gain {min(gains):.1f} to {max(gains):.1f} a step" in TEXT


def test_bc_from_random_data_is_at_most_no_change():
    for column in page.COLUMNS:
        few, middle, many = (np.mean(of("random", data, "bc", column)) for data in (FEW, MIDDLE, MANY))
        assert max(few, middle) < known("random", "zero", column)
        assert column == LONG or abs(many - known("random", "zero", column)) < 0.1


def test_the_horizon_changes_who_is_best():
    cql = {column: of("random", MIDDLE, "cql", column) for column in page.COLUMNS}
    others = [x for x in page.LEARNED if x != "cql"]
    for column in (START, AROUND):
        assert all(above(cql[column], of("random", MIDDLE, x, column)) for x in others)
    assert all(above(of("random", MIDDLE, x, LONG), cql[LONG]) for x in ("td3+bc", "iql", "model-based"))


def test_who_needs_to_see_the_setpoint():
    def lost(algorithm, column):
        seen, blind = (of("random", MIDDLE, f"{algorithm}{x}", column) for x in ("", BLIND))
        return np.mean(seen) - np.mean(blind)

    start, around, long = (lost("iql", column) for column in page.COLUMNS)
    assert f"loses {long:.1f} a step" in TEXT
    assert f"loses {start:.1f} from the start settings and {around:.1f} from anywhere" in TEXT
    lowest = min(of("random", MIDDLE, "iql", LONG))
    assert sum(x < lowest for x in of("random", MIDDLE, f"iql{BLIND}", LONG)) == 2
    assert all(lost("model-based", column) < 0.05 for column in page.COLUMNS)


def test_published_formulas_have_no_order():
    stored = {row["policy"]: row for row in MEASURED["formulas"]}
    apart = []
    for name, value in formulas.PUBLISHED.items():
        error = stored[name]["error"] * np.sqrt(formulas.EPISODES)  # of one episode at each setpoint
        apart.append((stored[name]["return"] - 100 * value) / error)
    assert min(apart) > 0.0
    assert f"by {min(apart):.1f} to {max(apart):.1f} of their errors" in ABOUT["formulas"]


def test_where_safe_behaviour_is_improved():
    pairs = page.learned_parts(RESULTS, "safe")
    below = {x: sum(d.mean < -2 * d.standard_error for d in differences(*x, LONG)) for x in pairs}
    expected = {(FEW, "bc"): 2, (MIDDLE, "bc"): 2, (FEW, "model-based"): 2, (FEW, "iql"): 1}
    assert {x: count for x, count in below.items() if count} == expected
    assert [d.mean > 0 for d in differences(FEW, "iql", AROUND)].count(False) == 1
    for algorithm in ALL:
        for column in page.COLUMNS if algorithm != "bc" else (START, AROUND):
            assert all(d.mean > 0 for d in differences(MIDDLE, algorithm, column))


def test_at_which_setpoints_safe_behaviour_is_improved():
    rows = [line.strip("| ").split(" | ") for line in page.above_behaviour(RESULTS).splitlines()[2:]]
    counts = {(row[0], row[1]): row[4] for row in rows if row[4] != "0"}
    assert counts == {(FEW, "BC"): "6", (FEW, "TD3+BC"): "2"}
    assert "BC is below the behaviour at six setpoints and TD3+BC at two" in TEXT
    assert {row[5].split()[-1] for row in rows if row[1] != "BC"} <= {"40", "50", "60"}
    base = RESULTS.known("safe", "behaviour", page.AT_TEN)
    at_100 = [(x - base)[-1].mean() for x in RESULTS.returns("safe", FEW, "bc", page.AT_TEN)]
    assert np.mean(sorted(at_100)[1:]) > 0.0


def test_where_safe_data_are_harder():
    def better(name, other):
        pairs = [(x, column) for x in ALL for column in page.COLUMNS]
        return {(x, c) for x, c in pairs if above(of(name, MIDDLE, x, c), of(other, MIDDLE, x, c))}

    over_100 = {("bc", START), ("bc", AROUND), ("td3+bc", AROUND)}
    assert better("safe", "random") == {*over_100, *((x, LONG) for x in ("td3+bc", "iql", "cql"))}
    assert better("random", "safe") == {(x, c) for x in ("model-based", "cql") for c in (START, AROUND)}


def test_policies_at_the_target():
    [settings] = EVALUATIONS["transfer"]
    zero, optimized = (RESULTS.known("transfer", x, settings).mean() / 100 for x in ("zero", "optimized"))
    cells = {(run.trained_on, run.algorithm): at_75(run.trained_on, run.algorithm) for run in transfer(0)}
    assert max(map(max, cells.values())) < optimized
    below = sum(max(seeds) < zero for seeds in cells.values())
    over = sum(min(seeds) > zero for seeds in cells.values())
    assert f"In {below} of the {len(cells)} cells, all seeds are below" in TEXT
    assert f"; in {over}, all are above" in TEXT
    assert max(cells, key=lambda x: np.mean(cells[x])) == ("10 at 75", "model-based")
    best = sorted(cells, key=lambda x: max(cells[x]))[-2:]
    assert best == [("5 at 75", "iql"), ("100 at 50, then 10 at 75", "model-based")]


def test_what_the_source_is_worth_to_the_model_based_policy():
    alone, pooled, tuned = (
        [np.mean(at_75(part(way, count), "model-based")) for count in (1, 2, 5, 10)]
        for way in ("target", "pooled", "fine-tuned")
    )
    assert alone[2] < pooled[0] < alone[3]
    assert f"rise by {alone[3] - alone[0]:.1f} from one episode to ten" in TEXT
    assert f"one after the other by {tuned[3] - tuned[0]:.1f}" in TEXT
    assert f"returns stay within {np.ptp(pooled):.1f}." in TEXT


def test_iql_is_harmed_by_a_setpoint_of_which_it_sees_few_data():
    source = np.mean(at_75("100 at 50", "iql"))
    for count in BLIND_FEW:
        data = part("pooled", count)
        seen, blind = at_75(data, "iql"), at_75(data, f"iql{BLIND}")
        assert len(blind) == 3
        assert np.mean(seen) < source - 5.0
        assert min(blind) > source - 1.0
    setpoints = np.repeat([50.0, 75.0], [100, 1])
    assert (75.0 - setpoints.mean()) / setpoints.std() == pytest.approx(10.0)


def test_no_distance_of_setpoints_predicts_better():
    errors = setpoint_map.errors(RESULTS, "source", "consumption")
    dissimilar = np.array(MEASURED["distances"]["consumption"])
    apart = np.abs(np.subtract.outer(SOURCES, TARGETS)).astype(float)
    draws = np.random.default_rng(0)

    def gain(at):
        seen = ~np.isnan(errors[at])
        ranks = [rank_correlation(grid[at][seen], errors[at][seen]) for grid in (dissimilar, apart)]
        return ranks[0] - ranks[1]

    drawn = [gain(draws.integers(len(SOURCES), size=len(SOURCES))) for _ in range(300)]
    low, high = np.quantile(drawn, [0.025, 0.975])
    assert f"between {-low:.2f} less and {high:.2f} more" in ABOUT["map"]


def test_the_source_in_the_map():
    few, more = (setpoint_map.errors(RESULTS, way, "consumption") for way in ("target", "fine-tuned"))
    assert f"In {(more < few).sum()} of {np.isfinite(more).sum()} pairs" in ABOUT["map"]
    sources = np.repeat(np.array(SOURCES, float)[:, None], len(TARGETS), axis=1)
    assert f"is {setpoint_map.rank_over(sources, setpoint_map.scores(RESULTS)):.2f}," in ABOUT["map"]


def test_the_best_runs_at_70():
    rows = [line for line in page.best_at_70(RESULTS).splitlines() if " runs | " in line]
    assert [" | `safe`, " in row for row in rows] == [True] * 5
    at = TEN.index(70.0)
    optimized = RESULTS.known("safe", "optimized", page.LONG_AT_TEN)[at].mean()
    seeds = RESULTS.returns("safe", MIDDLE, "iql", page.LONG_AT_TEN)
    assert sum(values[at].mean() > optimized for values in seeds) == 1
