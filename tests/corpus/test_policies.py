"""Misbehaving policies give an error that names policy, episode and step, or the data of a correct policy."""

from __future__ import annotations

import itertools
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
from helpers.odd import PLAIN, STEPS, good

from ibdata import Experiment
from ibdata.errors import PolicyError
from ibdata.experiment.rollout import rollout
from ibdata.policies import Decision, Needs, Policy

pytestmark = pytest.mark.corpus

LANES = 4
KEPT = np.empty((LANES, 3))
GIVEN: list[np.ndarray] = []


class Odd(Policy):
    """Good actions, changed by what a test gives: `answer(self, history, u, step)`."""

    needs: ClassVar[Needs] = Needs(step_draws=3)
    answer: ClassVar[Any] = None
    calls: ClassVar[Any] = itertools.count()

    kind: Literal["odd"] = "odd"

    def decide(self, given):
        history, u = given.observations, given.uniforms
        return Decision(type(self).answer(history, u, next(type(self).calls) % STEPS), given.memory)


@pytest.fixture
def experiment():
    """An experiment of four episodes with that policy."""
    options = Experiment.model_validate(PLAIN).options()
    return Experiment.model_construct(**{**options, "policies": [Odd(name="rogue")]})


@pytest.fixture
def played(experiment, monkeypatch):
    """The columns of the four episodes, played side by side, when the policy answers so."""

    def play(answer):
        monkeypatch.setattr(Odd, "answer", staticmethod(answer))
        monkeypatch.setattr(Odd, "calls", itertools.count())
        return rollout(experiment, 0, LANES)

    return play


def from_step_2(bad):
    """Good actions at first, then what `bad` makes of them."""
    return lambda history, u, step: good(history, u) if step < 2 else bad(good(history, u))


def put(lane, value):
    def change(action):
        action = action.astype(object) if value is None else action
        action[lane, 1] = value
        return action

    return change


FOUND = "found actions of shape"
BAD = {  # what is done to the actions, the episode that is named, and the fault
    "NaN": (put(3, np.nan), 3, "found action"),
    "infinity": (put(1, np.inf), 1, "found action"),
    "minus infinity": (put(0, -np.inf), 0, "found action"),
    "None among objects": (put(2, None), 2, "found action"),
    "masked": (lambda a: np.ma.masked_greater(a, -9.0), 0, "found action"),
    "one masked": (lambda a: np.ma.array(a, mask=np.arange(12).reshape(4, 3) == 10), 3, "found action"),
    "overflown float16": (lambda a: np.full((4, 3), np.inf, np.float16), 0, "found action"),
    "complex": (lambda a: a + 0.5j, 0, ""),
    "one action for all": (lambda a: a[0], 0, f"{FOUND} (3,)"),
    "one component": (lambda a: a[:, :1], 0, f"{FOUND} (4, 1)"),
    "four components": (lambda a: np.ones((4, 4)), 0, f"{FOUND} (4, 4)"),
    "a lane too many": (lambda a: np.ones((5, 3)), 0, f"{FOUND} (5, 3)"),
    "transposed": (lambda a: a.T, 0, f"{FOUND} (3, 4)"),
    "no lanes": (lambda a: a[:0], 0, f"{FOUND} (0, 3)"),
    "nothing": (lambda a: None, 0, "found"),
    "a mapping": (lambda a: {"velocity": 1}, 0, "found"),
    "a generator": (lambda a: (row for row in a), 0, "found"),
    "itself in a list": (lambda a: [a, a], 0, "found"),
}


@pytest.mark.parametrize(("bad", "episode", "fault"), BAD.values(), ids=BAD)
def test_what_is_no_action_is_named_with_its_place(played, bad, episode, fault):
    with pytest.raises(PolicyError) as error:
        played(from_step_2(bad))
    assert str(error.value).startswith(f"policy rogue: episode {episode}: step 2: {fault}")
    assert "\n" not in str(error.value)


def raising(error):
    def act(history, u, step):
        if step == 4:
            raise error
        return good(history, u)

    return act


def changing(history, u, step):
    history[:, 0, 1] = 100.0
    return good(history, u)


RAISING = {
    "an error of its own": (raising(ValueError("boom")), "4", "boom"),
    "an error of two lines": (raising(RuntimeError("one\ntwo")), "4", "one"),
    "an error without words": (raising(KeyError()), "4", "KeyError"),
    "an assertion": (raising(AssertionError()), "4", "AssertionError"),
    "the end of an iterator": (raising(StopIteration()), "4", "StopIteration"),
    "an error of the system": (raising(OSError(28, "No space left on device")), "4", "No space left"),
    "a division": (lambda history, u, step: 1 // 0, "0", "division"),
    "a change of what it sees": (changing, "0", "read-only"),
}


@pytest.mark.parametrize(("answer", "step", "word"), RAISING.values(), ids=RAISING)
def test_a_policy_that_raises_is_named_with_its_place(played, answer, step, word):
    with pytest.raises(PolicyError) as error:
        played(answer)
    line = str(error.value)
    assert line.startswith("policy rogue: episode")
    assert f": step {step}: " in line
    assert word in line


def kept(history, u, step):
    KEPT[:] = good(history, u)
    return KEPT


def changed_later(history, u, step):
    for action in GIVEN:
        action[:] = np.nan
    GIVEN.append(good(history, u))
    return GIVEN[-1]


def noisy(history, u, step):
    print("look at me")
    return good(history, u)


def seeding(history, u, step):
    np.random.seed(1)  # noqa: NPY002
    return good(history, u)


FINE = {
    "the same object at every step": kept,
    "an array that is changed later": changed_later,
    "a negative stride": lambda h, u, t: good(h[::-1], u[::-1])[::-1],
    "columns of a larger array": lambda h, u, t: np.hstack([good(h, u), good(h, u)])[:, 3:],
    "column-major": lambda h, u, t: np.asfortranarray(good(h, u)),
    "big-endian": lambda h, u, t: good(h, u).astype(">f8"),
    "objects": lambda h, u, t: good(h, u).astype(object),
    "lists": lambda h, u, t: good(h, u).tolist(),
    "masked, but nothing is": lambda h, u, t: np.ma.array(good(h, u)),
    "read-only": lambda h, u, t: np.broadcast_to(good(h, u), (1, 4, 3))[0],
    "with words on stdout": noisy,
    "with a seed for everyone": seeding,
}


@pytest.mark.parametrize("answer", FINE.values(), ids=FINE)
def test_actions_in_another_form_are_the_same_actions(played, answer):
    expected = played(lambda h, u, t: good(h, u))
    made = played(answer)
    assert made.table.tobytes() == expected.table.tobytes()
    assert made.clipped == expected.clipped


@pytest.mark.parametrize(
    ("answer", "velocity", "clipped"),
    [
        (lambda h, u, t: np.full((4, 3), 1e308), 1.0, 24),
        (lambda h, u, t: np.full((4, 3), -1e308), -1.0, 24),
        (lambda h, u, t: np.full((4, 3), 2, dtype=np.int64), 1.0, 24),
        (lambda h, u, t: np.full((4, 3), 200, dtype=np.uint8), 1.0, 24),
        (lambda h, u, t: np.full((4, 3), 0.1, dtype=np.float16), np.float32(np.float16(0.1)), 0),
        (lambda h, u, t: np.ones((4, 3), dtype=np.bool_), 1.0, 0),
        (lambda h, u, t: np.full((4, 3), 5e-324), 0.0, 0),
    ],
    ids=["huge", "minus huge", "integers", "bytes", "float16", "booleans", "subnormal"],
)
def test_finite_actions_out_of_range_are_clipped_and_counted(played, answer, velocity, clipped):
    made = played(answer)
    assert (made.table[made.names.index("act_velocity")] == velocity).all()
    assert made.clipped == clipped
