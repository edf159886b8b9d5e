"""Policies are compared with the shipped baselines of a set, episode by episode."""

from __future__ import annotations

import re

import numpy as np
import pytest
from helpers import FULL
from helpers.evaluating import LITERATURE
from helpers.evaluating import baseline as made
from helpers.objects import still
from helpers.refusals import refused

import ibdata
from ibdata import IbdataError
from ibdata.evaluation import baselines as against
from ibdata.evaluation.baselines import Baseline

OWN = np.linspace(-6100.0, -5900.0, 200)


def baseline(name: str, algorithm: str, seed: int | None, returns) -> Baseline:
    return made(returns, set=name, algorithm=algorithm, seed=seed)


@pytest.fixture
def shipped(monkeypatch):
    lines = [
        baseline("siemens-offline/optimized-40", "behaviour", None, OWN - 100.0),
        baseline("siemens-offline/optimized-40", "bc", 1, OWN),
        baseline("siemens-offline/optimized-40", "bc", 2, OWN + 20.0),
        baseline("siemens-offline/optimized-40", "cql", 0, None),
        baseline("d4rl-like/medium", "bc", 0, OWN),
        baseline("neorl-like/medium", "bc", 0, OWN),
    ]
    monkeypatch.setattr(against, "shipped_baselines", lambda: lines)


TWO = {**LITERATURE, "setpoint": [20.0, 50.0], "episodes": 3, "steps": 4}
ANYWHERE = {**TWO, "start": {"burn_in": [2, 5]}, "discount": 1.0}


@pytest.fixture
def evaluated_twice(monkeypatch):
    """A set whose run was evaluated with two settings, beside a set of the same last name."""
    both = [np.arange(6.0).reshape(2, 3) - offset for offset in (1000.0, 2000.0)]
    line = made(both[0], TWO, set="random", algorithm="bc", seed=0, trained_on="1 episode each")
    anywhere = made(both[1], ANYWHERE, set="random", algorithm="bc", seed=0).evaluations
    line = line.model_copy(update={"evaluations": [*line.evaluations, *anywhere]})
    other = baseline("d4rl-like/random", "bc", 0, OWN)
    monkeypatch.setattr(against, "shipped_baselines", lambda: [line, other])


@pytest.mark.parametrize(
    ("given", "settings", "base"),
    [
        ({}, TWO, 1000.0),
        ({"setpoint": {"start": 20, "stop": 50, "step": 30}, "steps": 4.0}, TWO, 1000.0),
        ({"start": {"burn_in": [2, 5]}}, ANYWHERE, 2000.0),
        ({"discount": 1}, ANYWHERE, 2000.0),
    ],
)
def test_settings_are_those_of_the_first_evaluation_that_agrees(evaluated_twice, given, settings, base):
    found = ibdata.evaluate("safe", against="random", **given)
    assert np.array_equal(found.returns, ibdata.evaluate("safe", **settings).returns)
    line = found.algorithms[-1]
    assert (line.algorithm, line.source, line.seeds) == ("bc", "1 episode each", 1)
    assert line.mean_return == pytest.approx(2.5 - base)
    [difference] = [x for x in found.differences if x.minus.startswith("bc") and x.setpoint is None]
    assert difference.minus == "bc (1 episode each)"
    assert difference.mean_difference == pytest.approx(found.returns.mean() - 2.5 + base, abs=0.01)
    assert found.notes[-1].startswith("against random: setpoint [20, 50], start ")


def test_settings_that_agree_with_no_evaluation_are_refused_beside_the_nearest(evaluated_twice):
    message = r"steps: found 7, expected 4: .* start \{burn_in: \[2, 5\]\}, .* discount 1,"
    with pytest.raises(IbdataError, match=message):
        ibdata.evaluate("safe", against="random", discount=1, start={"burn_in": [2, 5]}, steps=7)
    with pytest.raises(IbdataError, match=r"found uniform, expected default or \{burn_in: \[2, 5\]\}: "):
        ibdata.evaluate("safe", against="random", start="uniform")


def test_every_shipped_set_compares_a_policy_in_its_own_episodes():
    """Known policies are played again with the returns that are stored."""
    for name in (
        "random",
        "drifting",
        "random-paper",
        *(("safe", "transfer", "setpoints/random") if FULL else ()),
    ):
        found = ibdata.evaluate({"again": "mediocre"}, against=name)
        lines = [x for x in found.differences if x.minus == "mediocre (known)"]
        assert max(abs(line.mean_difference) for line in lines) < 0.001


def test_baselines_are_there_only_if_asked_for(shipped):
    found = ibdata.evaluate("safe", against="d4rl-like/medium")
    assert found.plain()["algorithms"][-1]["algorithm"] == "bc"
    assert "against d4rl-like/medium: " in repr(found)
    assert "constant" not in repr(ibdata.evaluate("safe", episodes=2, steps=2))
    assert ibdata.evaluate("safe", steps=2).returns.shape == (1, 1, 100)
    seen = ibdata.evaluate(still, against="optimized-40", view={"actions": True})  # may be compared
    failed = seen.algorithms[-1]
    assert (failed.algorithm, failed.seeds, failed.mean_return) == ("cql", 0, None)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"episodes": 100}, "episodes: found 100, expected 200: against optimized-40 compares"),
        ({"discount": 0.99}, "discount: found 0.99, expected 0.97"),
        ({"setpoint": [70, 50]}, "setpoint: found [70, 50], expected 70"),
        ({"start": {"burn_in": [1, 2]}}, "start: found {burn_in: [1, 2]}, expected default"),
        ({"dynamics": "paper"}, "dynamics: found paper, expected siemens"),
        (
            {"view": {"reward": "delta"}},
            "reward: found delta, expected classic: against compares",
        ),
        ({"against": "medium"}, "against: found 'medium', expected one of optimized-40, d4rl-like/medium"),
        ({"against": "optimised-40"}, "did you mean 'optimized-40'?"),
    ],
)
def test_other_episodes_and_unknown_sets_are_refused_in_one_line(shipped, changes, message):
    refused(re.escape(message), ibdata.evaluate, still, **{"against": "optimized-40", **changes})
