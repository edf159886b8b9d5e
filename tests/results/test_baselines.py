"""The results of offline algorithms: how the script keeps them, and what the page says of them."""

from __future__ import annotations

import re
import sys

import numpy as np
import pytest
from helpers import ROOT, script
from helpers.evaluating import LITERATURE, baseline

import ibdata
from ibdata.evaluation.baselines import FILE, WHOLE, Baseline, measured, shipped_baselines
from ibdata.policies import expert
from measuring.documents import measured as tables_of
from training import baselines_page as page
from training.runner import Runner

LINES = shipped_baselines([FILE])
PAGE = (ROOT / "docs/baselines.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def baselines():
    return script("baselines")


@pytest.fixture
def run(baselines, tmp_path, monkeypatch, capsys):
    """A function that runs a part of the plan untrained, and returns the results and what it prints."""

    def run(plan, *arguments, made=lambda key, data: line(key), file="x.jsonl"):
        one = Runner("", plan, Baseline, tmp_path / file, made, baselines.describe, lambda lines: None)
        monkeypatch.setattr(sys, "argv", ["baselines", *arguments])
        capsys.readouterr()
        one.main()
        return list(one.known(one.file).values()), capsys.readouterr().out.splitlines()

    return run


def line(run, shift=0.0) -> Baseline:
    return baseline(np.linspace(-7000.0, -6000.0, 200) + shift, **run._asdict())


def test_a_line_keeps_the_returns_and_their_statistics(baselines):
    returns = np.random.default_rng(0).normal(-6000.0, 50.0, 200)
    made = line(baselines.plan()[0]).model_copy(update={"evaluations": [measured(LITERATURE, returns[None])]})
    [kept] = Baseline.model_validate_json(made.model_dump_json()).evaluations
    np.testing.assert_allclose(kept.values, [returns], rtol=1e-7)
    assert kept.mean_return == pytest.approx(returns.mean())
    assert kept.standard_error == pytest.approx(returns.std(ddof=1) / np.sqrt(200), rel=1e-4)
    assert kept.p10 == pytest.approx(np.quantile(returns, 0.1))
    failed = measured(LITERATURE, None, "NaN")
    assert (failed.mean_return, failed.values, failed.failure) == (None, None, "NaN")
    assert kept.settings == failed.settings == LITERATURE


def test_the_script_makes_what_is_missing_and_says_so(baselines, run, tmp_path):
    """Each result is in the file before the next run begins, so a killed script loses one run only."""
    plan, made, kept = baselines.plan()[14:20], [], []

    def make(key, data):
        made.append(key)
        kept.append(len(shipped_baselines([tmp_path / "x.jsonl"])))
        return line(key)

    run([plan[1]])
    lines, _ = run(plan, made=make)
    assert made == [plan[0], *plan[2:]]
    assert kept == [1, 2, 3, 4, 5]
    assert lines == [line(key) for key in plan]
    run(plan, made=make)
    assert len(made) == 5
    lines, printed = run(plan, "--list")
    assert printed[2] == (
        "3/6 siemens-offline/bad-0 whole set bc 0: return -65.00 ± 0.21, 10th percentile -69.00, in hundreds"
    )


def test_a_run_that_fails_leaves_no_result_and_the_others_go_on(baselines, run, tmp_path, capsys):
    plan = baselines.plan()[14:18]

    def made(key, data):
        if key == plan[1]:
            raise FloatingPointError("NaN")
        return line(key)

    with pytest.raises(SystemExit, match="failed: 1 of 4 runs"):
        run(plan, made=made)
    assert shipped_baselines([tmp_path / "x.jsonl"]) == [line(key) for key in (plan[0], *plan[2:])]
    assert (
        "2/4 siemens-offline/optimized-80 whole set behaviour: failed\nTraceback" in capsys.readouterr().err
    )


def test_the_page_holds_the_results_that_were_run_and_no_others(baselines):
    assert tables_of(PAGE) == f"\n{page.block(LINES, baselines.plan())}\n"


def test_every_number_of_the_reading_is_a_result():
    """It is a mean over seeds, a single seed, or a reference."""
    reading = PAGE.partition("## Reading\n")[2].partition("The expert is\n")[0]
    numbers = re.findall(r"−[\d.]+\d", reading)
    assert numbers
    runs = ibdata.baselines()
    means = runs.groupby(["set", "algorithm"])["mean_return"].mean()
    values = [*runs["mean_return"], *means, *page.references().values()]
    assert set(numbers) <= {f"{value / 100:.1f}".replace("-", "−") for value in values}


@pytest.mark.parametrize(
    ("setpoint", "velocity", "gain", "said"),
    [
        (70, None, 10, "gains higher by 10 get −56.5"),
        (53, 29, 20, "gains higher by 20 get −46.9"),
        (53, None, 0, "the expert −49.2"),
    ],
)
def test_the_expert_is_no_bound_over_100_steps(setpoint, velocity, gain, said, monkeypatch):
    table, feedback = expert.numbers("siemens")
    table = table.copy()
    table[:, expert.AIM] = velocity or table[:, expert.AIM]
    table[:, expert.GAINS :] = np.clip(table[:, expert.GAINS :] + gain, 0, 100)
    monkeypatch.setattr(expert, "numbers", lambda dynamics: (table, feedback))
    [found] = ibdata.evaluate("expert", setpoint=setpoint, episodes=1000).results
    assert said in re.sub(r"\s+", " ", PAGE)
    assert f"{found.mean_return / 100:.1f}".replace("-", "−") == said.split()[-1]


def test_tables_show_means_of_seeds_and_dashes_for_gaps(baselines):
    runs = [baselines.Run("siemens-offline/bad-0", WHOLE, "bc", seed) for seed in (0, 1)]
    runs.append(baselines.Run("siemens-offline/bad-0", WHOLE, "cql", 0))
    failed = line(runs[2]).model_copy(update={"evaluations": [measured(LITERATURE, None, "NaN")]})
    block = page.block([line(runs[0]), line(runs[1], shift=100.0), failed], baselines.plan())
    assert block.startswith("3 of 341 runs are done; ")
    rows = [text for text in block.splitlines() if text.startswith("| `siemens-offline/bad-0`")]
    assert rows == ["| `siemens-offline/bad-0` | – | −64.5 | – | – | 1 failed | – |"]


def test_runs_are_counted_by_their_paired_difference(baselines):
    def of(name, algorithm, returns):
        run = baselines.Run(name, WHOLE, algorithm, None if algorithm == "behaviour" else 0)
        return baseline(returns, **run._asdict())

    own = np.random.default_rng(0).normal(-6000.0, 50.0, 200)
    noise = np.where(np.arange(200) % 2, 1.0, -1.0)
    lines = [
        of("siemens-offline/bad-0", "behaviour", own + 2.0),  # the formula alone
        of("siemens-offline/bad-40", "behaviour", own),
        of("siemens-offline/bad-40", "bc", own + 1.0 + noise),  # far less than the deviation of the returns
        of("siemens-offline/bad-40", "td3+bc", own + noise),
        of("siemens-offline/bad-40", "iql", own - 1.0 + noise),
        of("siemens-offline/bad-40", "cql", None),
        of("siemens-offline/bad-40", "bcq", own + 3.0 + noise),
        of("d4rl-like/random", "behaviour", own),
        of("d4rl-like/random", "bcq", own - 1.0),
    ]
    assert page.algorithms(lines).splitlines()[2:] == [
        "| BC | 1 | 1 | 1 / 0 / 0 | 0 / 0 / 1 | – | – |",
        "| TD3+BC | 1 | 1 | 0 / 1 / 0 | 0 / 0 / 1 | – | – |",
        "| IQL | 1 | 1 | 0 / 0 / 1 | 0 / 0 / 1 | – | – |",
        "| CQL | 1 | 1 | 0 / 0 / 1 | 0 / 0 / 1 | – | – |",
        "| BCQ | 2 | 1 | 1 / 0 / 1 | 1 / 0 / 0 | – | – |",
    ]


def test_shipped_lines_are_those_of_the_plan_in_its_order(baselines):
    keys = [baselines.Run(*each.key) for each in LINES]
    assert keys == [run for run in baselines.plan() if run in set(keys)]
    assert FILE.stat().st_size < 750_000
    for each in LINES:
        [evaluated] = each.evaluations
        assert evaluated == measured(LITERATURE, evaluated.values)


def test_the_behaviour_is_played_again_with_the_same_returns(baselines, monkeypatch):
    class Dataset:
        content_root = "0" * 64

    monkeypatch.setattr(baselines.runner, "dataset", lambda name, data: Dataset)
    shipped = {each.set: each for each in LINES if each.algorithm == "behaviour"}
    for name in ("siemens-offline/optimized-40", "siemens-offline/bad-0"):
        again = baselines.behaviour(baselines.Run(name, WHOLE, "behaviour", None), None)
        assert again.evaluations == shipped[name].evaluations


def test_the_data_frame_has_a_row_per_evaluation():
    frame = ibdata.baselines()
    assert len(frame) == sum(len(each.evaluations) for each in shipped_baselines()) >= len(LINES) > 0
    known = frame["trained_on"].eq("nothing") | frame["algorithm"].eq("behaviour")
    assert frame["seed"].isna().equals(known)
    assert [x.shape[1] for x in frame["returns"].dropna()] == frame.dropna(subset="returns")[
        "episodes"
    ].tolist()
    row = frame.iloc[0]
    assert row["mean_return"] == pytest.approx(row["returns"].mean())


def test_published_percentiles_stand_beside_the_seeds_mean():
    frame = ibdata.baselines(published=True)
    assert frame.groupby("algorithm")["set"].nunique().to_dict() == dict.fromkeys(frame["algorithm"], 16)
    assert frame["published_p10"].between(-33_000, -5_800).all()
    (row,) = frame[(frame["set"] == "siemens-offline/bad-40") & (frame["algorithm"] == "td3+bc")].itertuples()
    seeds = [
        each.evaluations[0].p10 for each in LINES if (each.set, each.algorithm) == (row.set, row.algorithm)
    ]
    assert (row.published_p10, len(seeds)) == (-23_000, 3)
    assert row.p10 == pytest.approx(np.mean(seeds))
    assert row.difference == pytest.approx(row.p10 - row.published_p10)
    assert set(frame.dropna()["algorithm"]) == {"td3+bc", "cql", "bcq", "bear"}


def test_the_words_about_the_literature_agree_with_the_data():
    text = re.sub(r"\s+", " ", PAGE.partition("## Beside the literature\n")[2])
    frame = ibdata.baselines(published=True).assign(set=lambda x: x["set"].str.partition("/")[2])
    differences = frame.pivot(index="set", columns="algorithm", values="difference") / 100
    bad = [f"bad-{share}" for share in (20, 40, 60)]
    assert f"{differences.loc[bad, 'td3+bc'].min():.0f} to {differences.loc[bad, 'td3+bc'].max():.0f}" in text
    cql = differences.loc[[*bad, "bad-80"], "cql"]
    assert f"{cql.min():.0f} to {cql.max():.0f} better" in text
    assert f"{-differences.loc['bad-0', 'cql']:.0f} worse" in text
    known = frame.pivot(index="set", columns="algorithm", values="published_p10")
    models = known[["moose", "wsbc", "mopo", "morel"]]
    assert f"on {(models.max(axis=1) == known.max(axis=1)).sum()} of the 16 sets the best" in text
    assert f"on {(models.min(axis=1) == known.min(axis=1)).sum()} so is the worst" in text
