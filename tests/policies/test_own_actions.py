"""Actions of users' policies: discrete ones, ones that are clipped, and what is said of those that fail."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.refusals import refused

from ibdata import evaluate
from ibdata.errors import PolicyError
from ibdata.policies import Decision, Deterministic
from ibdata.policies.distributions import DISCRETE

FEW = {"episodes": 3, "steps": 20}


def numbered(observations):
    """Whole numbers, which differ between steps and episodes."""
    return observations[:, 4].astype(np.int64) % 27


def spelt_out(observations):
    return np.array(DISCRETE)[numbered(observations)]


class Deciding:
    def decide(self, given):
        return Decision(numbered(given.observations[:, 0]).tolist(), given.memory)


class Numbered(Deterministic):
    kind: str = "numbered"

    def decide(self, given):
        return Decision(numbered(given.observations[:, 0]), given.memory)


@pytest.mark.parametrize(
    "policy",
    [numbered, lambda seen: (numbered(seen).astype(np.int8), None), Deciding(), Numbered()],
    ids=["a function", "short", "a list", "a policy"],
)
def test_whole_numbers_are_the_discrete_actions(policy):
    found = evaluate([policy, spelt_out], **FEW)
    assert found.returns[0].tolist() == found.returns[1].tolist()
    assert found.returns[0].std() > 0.0


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda seen: np.full(len(seen), 27), r"found \[27, .*, expected discrete actions from 0 to 26"),
        (lambda seen: np.full(len(seen), -1), r"found \[-1, .*, expected discrete actions from 0 to 26"),
        (lambda seen: np.full(len(seen), 13.0), r"of shape \(32,\), expected actions of shape \(32, 3"),
        (lambda seen: np.ma.masked_all(len(seen), int), r"found actions of shape \(32,\), expected actions"),
        (lambda seen: np.full(len(seen) + 1, 13), r"found actions of shape \(33,\), expected actions"),
    ],
    ids=["above", "below", "floats", "masked", "others"],
)
def test_other_numbers_are_no_discrete_actions(answer, message):
    refused(message, evaluate, answer, **FEW, error=PolicyError)


def targets(observations):
    return np.full((len(observations), 3), 60.0)


class SureTargets(Deterministic):
    kind: str = "targets"

    def decide(self, given):
        return Decision(targets(given.observations), given.memory)


OFTEN = "100% of the numbers of its actions are clipped: actions are changes in [-1, 1]"


class Seldom:
    """In each second step, one of three numbers is too large."""

    def decide(self, given):
        return Decision(np.where(given.step[:, None] % 2, [2.0, 0.0, 0.0], 0.5), given.memory)


@pytest.mark.parametrize(
    ("policy", "clipped", "notes"),
    [
        ({"mine": targets}, 1.0, [f"mine: {OFTEN}"]),
        ({"kind": "custom", "target": SureTargets()}, 1.0, [f"suretargets: {OFTEN}"]),
        ({"kind": "epsilon_greedy", "base": targets, "epsilon": 0.5}, 0.0, [f"epsilon_greedy: {OFTEN}"]),
        (Seldom(), 0.5, []),
        ("mediocre", 1.0, []),
    ],
    ids=["a function", "a block", "a base", "a sixth", "of ibdata"],
)
def test_an_evaluation_says_that_much_is_clipped(policy, clipped, notes):
    found = evaluate(policy, setpoint=0, episodes=4, steps=20)
    assert [note for note in found.notes if "clipped" in note] == notes
    assert found.results[0].clipped == clipped


class Drawing:
    def act(self, history, u):
        return 0.5 * history[:, 0, 1:4] / 100.0 + u


def test_a_failure_says_what_to_do():
    message = "no random numbers; if it draws 3 per step, write draws: 3 beside its target in a block"
    refused(message, evaluate, Drawing(), **FEW, error=PolicyError)
