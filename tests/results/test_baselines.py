"""The results of offline algorithms: how the script keeps them, and what the page says of them."""

from __future__ import annotations

import re

import numpy as np
import pytest
from helpers import ROOT, script
from helpers.evaluating import LITERATURE
from scipy import stats

import ibdata
from ibdata.evaluation.baselines import FILE, WHOLE, measured, shipped_baselines
from ibdata.policies import expert
from measuring.documents import measured as tables_of
from training import baselines_page as page
from training import field

LINES = shipped_baselines([FILE])
PAGE = (ROOT / "docs/baselines.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def baselines():
    return script("baselines")


def test_the_page_holds_the_results_that_were_run_and_no_others(baselines):
    assert tables_of(PAGE) == f"\n{page.block(LINES, baselines.plan())}\n"


def test_bold_is_what_is_better_than_each_other_of_its_row():
    """By hand: the squares of the half-widths over seeds and over episodes add up (MOVER)."""
    returns = {
        key: np.array([page.returns_of(line) for line in lines]) for key, lines in page.grouped(LINES).items()
    }
    rows = re.findall(r"^\| `(\w+-like/.+?|siemens.+?)` \| (.+) \|$", tables_of(PAGE), re.MULTILINE)
    assert len(rows) == 24 + 4
    bold = []
    for name, text in rows:
        cells = text.split(" | ")
        names = ["behaviour", *(page.TWO if len(cells) == 3 else [*page.FOUR, page.MODEL])]
        known = [x for x in names if x == "behaviour" or len(returns.get((name, x), [])) == 3]
        best, *others = sorted(known, key=lambda x: -returns[name, x].mean())
        is_clear = all(lowest(returns[name, best], returns[name, x]) > 0 for x in others)
        expected = [x == best and is_clear for x in names]
        assert [cell.startswith("**") for cell in cells] == expected, name
        bold += [name] * is_clear
    assert bold == ["d4rl-like/medium-replay", "siemens-offline/optimized-40"]


def lowest(one, other):
    """The lower end of the interval of a difference of returns (seeds, episodes)."""
    difference = one.mean(axis=0) - other.mean(axis=0)
    halves = [stats.t.ppf(0.975, len(difference) - 1) * stats.sem(difference)]
    halves += [stats.t.ppf(0.975, 2) * stats.sem(x.mean(axis=1)) for x in (one, other) if len(x) == 3]
    return difference.mean() - np.hypot.reduce(halves)


def test_the_picture_has_the_scores_of_all_seeds():
    rows = dict(field.rows(LINES))
    assert len(rows) == 24 + 5
    for name, policy in (("global-100", 0.0), ("optimized-0", 100.0), ("random", 0.0)):
        assert rows[name]["behaviour"] == [pytest.approx(policy)]
    for name in rows.keys() - {"random", "safe"}:
        assert all(len(rows[name][x]) == 3 for x in ("bc", "iql")), name
    means = {(x.set.rpartition("/")[2], x.algorithm): page.mean_of(x) for x in LINES}
    low, high = (means[x, "behaviour"] for x in ("global-100", "optimized-0"))
    expected = 100 * (means["bad-0", "model-based"] - low) / (high - low)
    assert rows["bad-0"]["model-based"] == [pytest.approx(expected)]


@pytest.mark.slow
def test_the_expert_is_no_bound_over_100_steps(monkeypatch):
    table, feedback = expert.numbers("siemens")
    table = table.copy()
    table[:, expert.GAINS :] = np.clip(table[:, expert.GAINS :] + 10, 0, 100)
    monkeypatch.setattr(expert, "numbers", lambda dynamics: (table, feedback))
    [found] = ibdata.evaluate("expert", setpoint=70, episodes=1000).results
    assert "With gains raised by 10 it gets −56.5 over 100 steps." in " ".join(PAGE.split())
    assert f"{found.mean_return / 100:.1f}" == "-56.5"


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
    evaluated = frame.dropna(subset="returns")
    assert [x.shape[1] for x in evaluated["returns"]] == evaluated["episodes"].tolist()
    row = frame.iloc[0]
    assert row["mean_return"] == pytest.approx(row["returns"].mean())


def test_published_percentiles_stand_beside_the_seeds_mean():
    frame = ibdata.baselines(published=True)
    assert frame.groupby("algorithm")["set"].nunique().to_dict() == dict.fromkeys(frame["algorithm"], 16)
    assert frame["published_p10"].between(-33_000, -5_800).all()
    (row,) = frame[(frame["set"] == "siemens-offline/bad-40") & (frame["algorithm"] == "td3+bc")].itertuples()
    of_row = [each for each in LINES if (each.set, each.algorithm) == (row.set, row.algorithm)]
    seeds = [each.evaluations[0].p10 for each in of_row]
    assert (row.published_p10, len(seeds)) == (-23_000, 3)
    assert row.p10 == pytest.approx(np.mean(seeds))
    assert row.difference == pytest.approx(row.p10 - row.published_p10)
    assert set(frame.dropna()["algorithm"]) == {"td3+bc", "cql", "bcq", "bear"}
