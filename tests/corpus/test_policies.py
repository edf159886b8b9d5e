"""Misbehaving policies give an error that names policy, episode and step, or the data of a correct policy."""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import pytest

import ibdata
from ibdata import Experiment
from ibdata.cli import main
from ibdata.errors import PolicyError
from ibdata.experiment.rollout import rollout
from ibdata.policies import Decision, Needs, Policy
from ibdata.policies.random import Random
from ibdata.validation.validate import validate

pytestmark = pytest.mark.corpus

STEPS = 6
PLAIN = {
    "name": "odd",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "random"}],
    "episodes": 2,
    "steps": STEPS,
    "output": {"shard_rows": STEPS},
}
LANES = 4
KEPT = np.empty((LANES, 3))


def good(history: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Reacts to what it sees and uses its draws."""
    return 0.4 * u - 0.2 + 0.001 * history[:, 0, 1:4]


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


BAD = {
    "NaN": (put(3, np.nan), "episode 3: step 2: found action"),
    "infinity": (put(1, np.inf), "episode 1: step 2: found action"),
    "minus infinity": (put(0, -np.inf), "episode 0: step 2: found action"),
    "None among objects": (put(2, None), "episode 2: step 2: found action"),
    "masked": (lambda a: np.ma.masked_greater(a, -9.0), "episode 0: step 2: found action"),
    "one masked": (
        lambda a: np.ma.array(a, mask=np.arange(12).reshape(4, 3) == 10),
        "episode 3: step 2: found action",
    ),
    "overflown float16": (lambda a: np.full((4, 3), np.inf, np.float16), "episode 0: step 2: found action"),
    "complex": (lambda a: a + 0.5j, "episode 0: step 2: "),
    "one action for all": (lambda a: a[0], "episode 0: step 2: found actions of shape (3,)"),
    "one component": (lambda a: a[:, :1], "episode 0: step 2: found actions of shape (4, 1)"),
    "four components": (lambda a: np.ones((4, 4)), "episode 0: step 2: found actions of shape (4, 4)"),
    "a lane too many": (lambda a: np.ones((5, 3)), "episode 0: step 2: found actions of shape (5, 3)"),
    "transposed": (lambda a: a.T, "episode 0: step 2: found actions of shape (3, 4)"),
    "no lanes": (lambda a: a[:0], "episode 0: step 2: found actions of shape (0, 3)"),
    "nothing": (lambda a: None, "episode 0: step 2: found"),
    "a mapping": (lambda a: {"velocity": 1}, "episode 0: step 2: found"),
    "a generator": (lambda a: (row for row in a), "episode 0: step 2: found"),
    "itself in a list": (lambda a: [a, a], "episode 0: step 2: found"),
}


@pytest.mark.parametrize(("bad", "where"), BAD.values(), ids=BAD)
def test_what_is_no_action_is_an_error_that_names_policy_episode_and_step(played, bad, where):
    with pytest.raises(PolicyError) as error:
        played(from_step_2(bad))
    assert str(error.value).startswith(f"policy rogue: {where}")
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
def test_a_policy_that_raises_is_an_error_that_names_policy_episodes_and_step(played, answer, step, word):
    with pytest.raises(PolicyError) as error:
        played(answer)
    line = str(error.value)
    assert line.startswith("policy rogue: episode")
    assert f": step {step}: " in line
    assert word in line


def kept(history, u, step):
    KEPT[:] = good(history, u)
    return KEPT


def noisy(history, u, step):
    print("look at me")
    return good(history, u)


def seeding(history, u, step):
    np.random.seed(1)  # noqa: NPY002
    return good(history, u)


FINE = {
    "the same object at every step": kept,
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


def test_an_answer_that_is_changed_later_was_taken_when_it_was_given(played):
    given: list[np.ndarray] = []

    def changed_later(history, u, step):
        for action in given:
            action[:] = np.nan
        given.append(good(history, u))
        return given[-1]

    expected = played(lambda h, u, t: good(h, u))
    assert played(changed_later).table.tobytes() == expected.table.tobytes()


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


@pytest.fixture
def generated(monkeypatch, tmp_path):
    """Generate into out where the random policy answers so, given how often it has been asked."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Random, "needs", Needs(history=1, step_draws=3))
    monkeypatch.setattr("ibdata.generation.workers.available_processors", lambda: 1)  # shards in order
    monkeypatch.setattr("ibdata.experiment.self_check.answer", lambda: "0" * 64)  # it plays this policy too

    def generate(answer, resume=False):
        calls = itertools.count()

        def decide(self, given):
            return Decision(answer(given.observations, given.uniforms, next(calls)), given.memory)

        monkeypatch.setattr(Random, "decide", decide)
        experiment = Experiment.model_validate(PLAIN)
        return ibdata.generate(experiment, "out", workers=1, resume=resume)

    return generate


@pytest.mark.parametrize("asked", [0, 1, 2, 7, 8, 8 + STEPS, 1 + 4 * STEPS])
@pytest.mark.parametrize("bad", [put(0, np.nan), lambda a: a[0]], ids=["NaN", "shape"])
def test_a_run_that_a_policy_ends_leaves_what_can_be_resumed_or_nothing(generated, bad, asked):
    """The warm-up asks twice, and a shard once a step."""

    def answer(history, u, call):
        return bad(good(history, u)) if call >= asked else good(history, u)

    with pytest.raises(PolicyError, match=r"^policy random: episode \d: step \d: found action"):
        generated(answer)
    assert not Path("out").exists()
    assert Path(".out.part").exists() == (asked >= 2 + STEPS)
    assert not [*Path().rglob("*manifest.json"), *Path().rglob(".tmp-*")]
    assert generated(lambda h, u, call: good(h, u), resume=True).manifest["rows"] == 4 * STEPS
    assert validate(Path("out")) == []
    assert os.listdir() == ["out"]


def test_clipped_actions_are_counted_in_the_manifest(generated):
    made = generated(lambda h, u, call: np.full((len(h), 3), 1e308))
    assert made.manifest["clipped_actions"] == len(made) == 24


def test_a_dataset_without_densities_is_shown_by_every_command(generated, monkeypatch, capsys):
    monkeypatch.setattr("ibdata.cli._end_at_signals", lambda: None)  # the tests have handlers of their own
    monkeypatch.setattr(Random, "log_density", Policy.log_density)
    generated(lambda h, u, call: good(h, u))
    capsys.readouterr()  # without this density, the known run of this machine has other bits
    for command in (["info"], ["stats"], ["head"], ["validate"], ["head", "--json"], ["stats", "--json"]):
        with pytest.raises(SystemExit) as end:
            main([*command, "out"])
        shown = capsys.readouterr()
        assert (end.value.code or 0, shown.err) == (0, ""), command
        if "--json" in command:
            json.loads(shown.out, parse_constant=pytest.fail)


SCRIPT = """
    import os
    import ibdata

    experiment = ibdata.Experiment.model_validate({plain})
    try:
        ibdata.generate(experiment, "out", workers=2, allow_code=True)
    except ibdata.IbdataError as error:
        print(error)
    print(sorted(os.listdir()))
"""
ENDING = """
    import os, sys

    class Ending:
        def act(self, history, u):
            if sys.argv[0] == "-c":  # in a worker
                os._exit(7)
            return 2.0 * u - 1.0
"""


def test_a_policy_that_ends_its_workers_is_an_error_and_leaves_nothing(tmp_path):
    script = tmp_path / "script.py"
    policy = {"kind": "custom", "target": "ending:Ending", "uniforms": 3}
    script.write_text(textwrap.dedent(SCRIPT).format(plain={**PLAIN, "policies": [policy]}))
    (tmp_path / "ending.py").write_text(textwrap.dedent(ENDING))
    done = subprocess.run(
        [sys.executable, "-B", "-W", "error", script],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
    )
    line, left = done.stdout.splitlines()
    assert line == (
        "a worker process ended with code 7, perhaps for lack of memory; run again with --resume and "
        "fewer --workers"
    )
    assert left == "['ending.py', 'script.py']"
    assert done.stderr == "ibdata: running the code of ending:Ending\n"
