"""The results on the paper's prototypes: tables and text agree with the runs, and samples are made again."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest
from helpers import ROOT, script

from ibdata.evaluation.baselines import NOTHING, PROTOTYPES, measured, shipped_baselines
from ibdata.policies import POLICIES
from ibdata.policies.weights_file import SHIPPED
from training import formulas
from training import prototypes_page as page
from training.plan import FOUR, SIZES, Run, episodes_each, plan, transfer
from training.protocol import EVALUATIONS, LITERATURE
from training.results import Results, difference, means

LINES = shipped_baselines([PROTOTYPES])
PAGE = (ROOT / "docs/prototypes.md").read_text(encoding="utf-8")
MEASURED = json.loads((ROOT / "docs/prototypes.json").read_text(encoding="utf-8"))


def test_the_page_and_the_tables_beside_it_show_the_runs():
    for kind, block in page.blocks(LINES).items():
        shown = PAGE.partition(f"<!-- {kind} -->\n")[2].partition(f"\n<!-- /{kind} -->")[0]
        assert shown == f"\n{block}\n", kind
    assert page.beside(LINES, MEASURED) == MEASURED["tables"]


def test_the_runs_are_those_of_the_plan_in_its_order():
    keys = [Run(*line.key) for line in LINES]
    assert keys == [run for run in plan() if run in set(keys)]
    for line in LINES:
        for evaluated in line.evaluations:
            assert evaluated == measured(evaluated.settings, evaluated.values, evaluated.failure)
        expected = EVALUATIONS[line.set]
        if line.set == "transfer" and line.trained_on != NOTHING:
            targets = Run(*line.key).targets()
            expected = [] if line.algorithm == "model" else [{**LITERATURE, "setpoint": p} for p in targets]
        assert [evaluated.settings for evaluated in line.evaluations] == expected


@pytest.mark.parametrize(
    "name", ["transfer", *(pytest.param(x, marks=pytest.mark.slow) for x in ("safe", "setpoints/expert"))]
)
def test_the_behaviour_is_played_again_with_the_same_returns(name):
    [shipped] = [line for line in LINES if (line.set, line.algorithm) == (name, "behaviour")]
    again = script("prototypes").known(Run(name, NOTHING, "behaviour", None))
    assert again.evaluations == shipped.evaluations


AGENTS = {line.weights: line for line in LINES if line.weights}


def test_each_agent_has_its_lines_and_each_line_its_agent():
    files = {hashlib.sha256(path.read_bytes()).hexdigest(): path.stem for path in SHIPPED.glob("random-*")}
    assert files == {sha256: Run(*line.key).agent for sha256, line in AGENTS.items()}
    for name in files.values():
        network = POLICIES["network"](file=name).weights
        run = Run(*next(line.key for line in AGENTS.values() if line.weights == network.sha256))
        trained = f"{run.algorithm}, seed {run.seed}, trained on {run.set}, {run.trained_on}"
        assert (network.metadata.provenance, network.metadata.frames) == (trained, 30)


@pytest.mark.slow
@pytest.mark.parametrize("weights", AGENTS, ids=lambda sha256: Run(*AGENTS[sha256].key).agent)
def test_the_lines_of_an_agent_are_those_of_its_file_bit_for_bit(weights):
    """tests/naive/test_agents.py does this with three networks and the first evaluation."""
    line = AGENTS[weights]
    again = script("prototypes").evaluated
    policy = {"kind": "network", "file": Run(*line.key).agent}
    assert [again(policy, evaluated.settings) for evaluated in line.evaluations] == line.evaluations


def test_the_formulas_have_their_returns_in_fewer_episodes():
    """40 episodes each. A difference of 5 standard errors happens once in a million."""
    again = formulas.measure(episodes=40)
    for row, stored in zip(again, MEASURED["formulas"], strict=True):
        assert row["policy"] == stored["policy"]
        for value, error in (("return", "error"), ("difference", "difference_error")):
            assert abs(row[value] - stored[value]) <= 5 * np.hypot(row[error], stored[error])
    published = {row["policy"]: row["return"] for row in MEASURED["formulas"]}
    assert published["21"] > published["29"] > published["27"]


RESULTS = Results(LINES)
FEW, MIDDLE, _ = (episodes_each(count) for count in SIZES["random"])
START, AROUND, LONG = page.COLUMNS
ALL = [*FOUR, "cql"]
TRAINED = [(name, *pair) for name in SIZES for pair in page.learned_parts(RESULTS, name)]


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


def test_the_readme_names_the_best_from_as_many_transitions():
    best = [max(ALL, key=lambda x: np.mean(of(name, MIDDLE, x, START))) for name in ("random", "safe")]
    assert best == ["cql", "iql"]


def test_where_safe_behaviour_is_improved():
    pairs = page.learned_parts(RESULTS, "safe")
    below = {x: sum(d.mean < -2 * d.standard_error for d in differences(*x, LONG)) for x in pairs}
    expected = {(FEW, "bc"): 2, (MIDDLE, "bc"): 2, (FEW, "model-based"): 2, (FEW, "iql"): 1}
    assert {x: count for x, count in below.items() if count} == expected
    assert [d.mean > 0 for d in differences(FEW, "iql", AROUND)].count(False) == 1
    for algorithm in ALL:
        for column in page.COLUMNS if algorithm != "bc" else (START, AROUND):
            assert all(d.mean > 0 for d in differences(MIDDLE, algorithm, column))


def test_where_safe_data_are_harder():
    def better(name, other):
        pairs = [(x, column) for x in ALL for column in page.COLUMNS]
        return {(x, c) for x, c in pairs if above(of(name, MIDDLE, x, c), of(other, MIDDLE, x, c))}

    over_100 = {("bc", START), ("bc", AROUND), ("td3+bc", AROUND)}
    assert better("safe", "random") == {*over_100, *((x, LONG) for x in ("td3+bc", "iql", "cql"))}
    assert better("random", "safe") == {(x, c) for x in ("model-based", "cql") for c in (START, AROUND)}


def test_policies_at_the_target():
    [settings] = EVALUATIONS["transfer"]
    optimized = RESULTS.known("transfer", "optimized", settings).mean() / 100
    cells = {(run.trained_on, run.algorithm): at_75(run.trained_on, run.algorithm) for run in transfer(0)}
    assert max(map(max, cells.values())) < optimized
    assert max(cells, key=lambda x: np.mean(cells[x])) == ("10 at 75", "model-based")
    best = sorted(cells, key=lambda x: max(cells[x]))[-2:]
    assert best == [("5 at 75", "iql"), ("100 at 50, then 10 at 75", "model-based")]
