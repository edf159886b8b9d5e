"""What people do with the environments, without Gymnasium: a row says what somebody does, and what is right.

`Env` has the methods of `IndustrialBenchmarkEnv`. Rows that need Gymnasium are in tests/bridges/gymnasium.
"""

from __future__ import annotations

import sys

import numpy as np
import pytest

import ibdata
from ibdata.environment.replayed import Replay
from ibdata.environment.settings import Fixed, frame_bounds, settings
from ibdata.environment.simulation import Simulation
from ibdata.environment.streams import Streams
from ibdata.errors import UsageError

pytestmark = pytest.mark.portable

BURN_IN = {"burn_in": [2, 9]}
UNSEEN = {"imperfections": {"missing": {"obs_gain": 1e-300}}}  # which never happens
TROUBLES = {
    "imperfections": {
        "delay": {"obs_fatigue": 2},
        "noise": {"obs_consumption": 5.0},
        "missing": {"obs_velocity": 0.3},
        "mask": True,
    }
}
WORLDS = {
    "siemens": {},
    "paper": {"dynamics": "paper", "setpoint": 20},
    "moving": {"setpoint": "drifting"},
    "moving, paper": {"setpoint": {"drifting": 95}, "dynamics": "paper"},
}
LANES = 6


class Env:
    """Lanes with a stream of random integers each, as those of the vector environment."""

    def __init__(self, lanes=LANES, **options):
        self.simulation = Simulation(settings(**options), lanes)
        self.streams = Streams(lanes)

    def reset(self, seed=None, which=None):
        which = self.simulation.everyone if which is None else np.array(which)
        for lane in which.tolist():
            self.streams.seed(lane, None if seed is None else seed + lane)
        self.simulation.reset(which, self.streams.draw)
        return self.frames()

    def frames(self):
        history = self.simulation.settings.history
        return self.simulation.observations().reshape(self.simulation.n, history, -1)

    def step(self, actions):
        rewards = self.simulation.step(self.simulation.everyone, np.float32(actions), self.streams.draw)
        return self.frames(), rewards


def actions(steps=12, lanes=LANES):
    return np.random.default_rng(0).uniform(-1, 1, (steps, lanes, 3)).astype(np.float32)


@pytest.fixture(scope="module")
def ds(tmp_path_factory):
    experiment = {"name": "x", "policies": ["random"], "episodes": 4, "steps": 12, "start": BURN_IN}
    experiment["setpoints"] = {"drifting": [20, 80]}
    return ibdata.generate(experiment, tmp_path_factory.mktemp("moving") / "made", workers=1)


def replayed(ds, episode, **options):
    """An environment that replays an episode, and the integers of its steps."""
    env = Env(1, setpoint="drifting", **options)
    replay = Replay.asked_for({"dataset": ds, "episode": episode}, env.simulation.settings, 1)
    env.streams.replay(0, replay.begin(env.simulation, np.array([0]))[0])
    return env


@pytest.mark.parametrize("world", WORLDS.values(), ids=WORLDS)
@pytest.mark.parametrize("start", ["uniform", BURN_IN], ids=["uniform", "burn-in"])
def test_a_view_that_shows_the_same(world, start):
    """Somebody adds a view that changes nothing to a history. Frames and rewards are the same."""
    plain, viewed = (Env(history=4, start=start, view=view, **world) for view in (None, {"actions": True}))
    first, seen = plain.reset(seed=3), viewed.reset(seed=3)
    np.testing.assert_array_equal(seen[..., :6], first)
    for taken in actions():
        (frames, rewards), (seen, same) = plain.step(taken), viewed.step(taken)
        np.testing.assert_array_equal(seen[..., :6], frames)
        np.testing.assert_array_equal(same, rewards)


def test_the_frames_of_a_burn_in():
    """Somebody begins after a burn-in. The history has its frames, in all columns of the view."""
    env = Env(history=4, start={"burn_in": [5, 9]}, view={"observe": "markov", "actions": True})
    first = env.reset(seed=0)
    assert (first[:, :-1, 6] == first[:, 1:, 6]).sum() == 0  # θ of the step before
    np.testing.assert_array_equal(first[:, :-1, 7], first[:, 1:, 6])
    assert (first[:, 0, -3:] == 0).all()
    assert (first[:, 1:, -3:] != 0).all()


def test_measurements_of_a_burn_in():
    """Somebody looks through bad sensors. The first row and all later ones are as with a single frame."""
    many, one = (Env(history=history, start=BURN_IN, view=TROUBLES) for history in (5, 1))
    seen = [(many.reset(seed=1), one.reset(seed=1))]
    seen += [(many.step(taken)[0], one.step(taken)[0]) for taken in actions()]
    for frames, newest in seen:
        np.testing.assert_array_equal(frames[:, 0], newest[:, 0])
    assert (seen[0][0][:, 0, 6] == 0).all()
    assert (seen[0][0][:, 1:, 6] == 1).any()


def test_one_lane_among_others():
    """Somebody begins anew in one lane. Its frames are those of a lane alone, and the others stay."""
    env, alone = Env(history=5, start=BURN_IN, view=TROUBLES), Env(1, history=5, start=BURN_IN, view=TROUBLES)
    env.reset(seed=1)
    before = env.step(actions()[0])[0]
    after = env.reset(seed=7, which=[2])
    np.testing.assert_array_equal(np.delete(after, 2, axis=0), np.delete(before, 2, axis=0))
    np.testing.assert_array_equal(after[2], alone.reset(seed=9)[0])


def test_two_resets_with_one_seed():
    """Somebody resets twice with the same seed. The episodes are the same, the frames before them too."""
    env = Env(history=5, start=BURN_IN, view=TROUBLES)
    np.testing.assert_array_equal(env.reset(seed=4), env.reset(seed=4))
    assert (env.reset() != env.reset(seed=4)).any()


def test_observations_that_are_changed():
    """Somebody scales observations in place. The environment keeps its own."""
    env, other = (Env(history=3, start=BURN_IN, view=UNSEEN) for _ in range(2))
    seen = env.reset(seed=4)
    other.reset(seed=4)
    seen /= 100.0
    np.testing.assert_array_equal(env.step(actions()[0])[0], other.step(actions()[0])[0])


@pytest.mark.parametrize("view", [None, UNSEEN, TROUBLES], ids=["plain", "unseen", "troubles"])
def test_a_replay_and_the_arrays_of_its_dataset(ds, view):
    """Somebody compares histories of a replay with `arrays`. They agree in all frames that are rows."""
    data = ds.arrays(history=4, view=view)
    columns = data["observations"].shape[1] // 4
    for episode in (0, 5):
        rows = np.flatnonzero(data["episode"] == episode)
        env = replayed(ds, episode, history=4, view=view)
        for t, row in enumerate(rows):
            expected = data["observations"][row].reshape(4, columns)
            np.testing.assert_array_equal(env.frames()[0, : t + 1], expected[: t + 1])
            assert t > 2 or (env.frames()[0, t + 1 :] != expected[t + 1 :]).any()
            _, rewards = env.step(data["actions"][[row]])
            assert np.float32(rewards[0]) == data["rewards"][row]


def test_a_replay_with_a_history_and_with_rows_that_it_has(ds):
    """Somebody trains on `arrays` after a burn-in, whose first history repeats the first row."""
    first = ds.arrays(history=4)["observations"].reshape(-1, 4, 6)[::12]
    assert (first == first[:, :1]).all()


def test_a_state_that_is_set(ds):
    """Somebody goes on from the state of a row. Its history repeats one frame: nothing before is known."""
    env = Env(1, setpoint="drifting", history=4, start=BURN_IN, view=UNSEEN)
    env.reset(seed=0)
    env.simulation.set_state(ibdata.state_at(ds, (2, 5)), np.array([0]), env.streams.draw)
    frames = env.frames()[0]
    assert (frames == frames[0]).all()


def test_what_is_seen_is_within_the_space():
    """Somebody clips to the bounds of the space. Nothing changes, also in the frames of a burn-in."""
    for view in (None, UNSEEN, TROUBLES, {"observe": "markov", "actions": True}):
        env = Env(history=4, start=BURN_IN, view=view)
        low, high = np.array(frame_bounds(env.simulation.settings))
        seen = [env.reset(seed=2), *(env.step(taken)[0] for taken in actions())]
        assert all(((low <= frames) & (frames <= high)).all() for frames in seen)


@pytest.mark.parametrize(
    "options", [{"episod": 3}, {"seed": 3}, {"setpoint": 20}, {"low": -0.1, "high": 0.1}]
)
def test_an_unknown_option_of_reset(options):
    """Somebody gives `reset` an option of another environment, or misspells one. It is refused."""
    with pytest.raises(UsageError, match=f"^options: found '{next(iter(options))}'"):
        Replay.asked_for(options, settings(), 1)


def test_no_options_of_reset():
    """Somebody gives `reset` no options, or an empty mapping. It begins as always."""
    assert Replay.asked_for(None, settings(), 1) is None
    assert Replay.asked_for({}, settings(), 1) is None


@pytest.mark.parametrize("name", ["setpoint", "dynamics", "start", "history", "view", "discrete_actions"])
def test_a_setting_that_is_set_later(name, monkeypatch):
    """Somebody writes `env.unwrapped.setpoint = 20`. It is refused, because nothing would read it."""
    made = type("Made", (Fixed,), {"__module__": "ibdata.environment.single"})()
    with pytest.raises(
        UsageError, match=f"^{name}: found a new value, expected it where an environment is m"
    ):
        setattr(made, name, 20)
    made.mine = 20


def test_a_subclass_with_attributes_of_its_own():
    """Somebody's subclass keeps its setpoint under this name. It may."""

    class Mine(Fixed):
        def __init__(self, setpoint):
            self.setpoint = setpoint

    assert Mine(20).setpoint == 20


def test_a_picture_without_matplotlib(monkeypatch):
    """Somebody renders without matplotlib, or lets Gymnasium's checker do it. What to install is said."""
    for name in [name for name in sys.modules if name.startswith(("matplotlib", "ibdata.plots."))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match=r"needs the package matplotlib: .*'ibdata\[plot\]'"):
        from ibdata.plots.episode import frame as frame
