"""Misbehaving policies give an error that names policy, episode and step, or the data of a correct policy.

tests/simulation/test_contract.py has the usual mistakes.
"""

import itertools
import os
from pathlib import Path

import numpy as np
import pytest

import ibdata
from ibdata.errors import PolicyError
from ibdata.experiment import Experiment
from ibdata.experiment.rollout import rollout
from ibdata.policies import Decision, Needs
from ibdata.policies.baselines import Random

pytestmark = pytest.mark.corpus

LANES, STEPS = 4, 6
EXPERIMENT = Experiment.model_validate(
    {
        "name": "odd",
        "setpoints": [20.0, 70.0],
        "policies": [{"kind": "random"}],
        "episodes": 2,
        "steps": STEPS,
        "output": {"shard_rows": STEPS},
    }
)


def good(history, u):
    """Reacts to what it sees and uses its draws."""
    return 0.4 * u - 0.2 + 0.001 * history[:, 0, 1:4]


@pytest.fixture
def answering(monkeypatch):
    """Let the random policy answer so, given what it sees, its draws, and how often it has been asked."""
    monkeypatch.setattr(Random, "needs", Needs(history=1, draws=3))
    monkeypatch.setattr("ibdata.experiment.self_check.answer", lambda: "0" * 64)  # it plays this policy too

    def arrange(answer):
        calls = itertools.count()

        def decide(self, given):
            return Decision(answer(given.observations, given.draws, next(calls)), given.memory)

        monkeypatch.setattr(Random, "decide", decide)

    return arrange


@pytest.fixture
def played(answering):
    """The columns of four episodes, played side by side, when the policy answers so."""

    def play(answer):
        answering(answer)
        return rollout(EXPERIMENT, 0, LANES)

    return play


def raising(action):
    raise RuntimeError("one\ntwo")


BAD = {  # what is done to the actions, the episode that is named, and the fault
    "not a number": (lambda a: np.where(np.arange(4)[:, None] == 3, np.nan, a), 3, "found action"),
    "one masked": (lambda a: np.ma.array(a, mask=np.arange(12).reshape(4, 3) == 10), 3, "found action"),
    "complex": (lambda a: a + 0.5j, 0, ""),
    "transposed": (lambda a: a.T, 0, "found actions of shape (3, 4)"),
    "nothing": (lambda a: None, 0, "found"),
    "an error": (raising, 0, "tests/corpus/test_policies.py:"),
}


@pytest.mark.parametrize(("bad", "episode", "fault"), BAD.values(), ids=BAD)
def test_what_is_no_action_is_named_with_its_place(played, bad, episode, fault):
    with pytest.raises(PolicyError) as error:
        played(lambda seen, u, call: good(seen, u) if call < 2 else bad(good(seen, u)))
    assert str(error.value).startswith(f"policy random: episode {episode}: step 2: {fault}")
    assert "\n" not in str(error.value)


@pytest.fixture
def generated(answering, monkeypatch, tmp_path):
    """Generate into out where the policy answers so."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ibdata.generation.workers.available_processors", lambda: 1)  # shards in order

    def generate(answer, **options):
        answering(answer)
        return ibdata.generate(EXPERIMENT, "out", workers=1, **options)

    return generate


@pytest.mark.parametrize("asked", [1, 2, 8, 1 + 4 * STEPS])
def test_a_run_that_a_policy_ends_goes_on(generated, asked):
    """The warm-up asks twice, and a shard once a step."""

    def answer(seen, u, call):
        return np.nan * u if call >= asked else good(seen, u)

    with pytest.raises(PolicyError, match=r"^policy random: episode \d: step \d: found action"):
        generated(answer)
    assert not Path("out").exists()
    assert Path(".out.part").exists() == (asked >= 2 + STEPS)
    made = generated(lambda seen, u, call: good(seen, u))
    assert made.manifest["rows"] == 4 * STEPS
    assert ibdata.validate("out") == []
    assert os.listdir() == ["out"]
