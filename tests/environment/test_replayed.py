"""The lanes of an environment replay the episodes of datasets, without Gymnasium."""

from __future__ import annotations

import re

import numpy as np
import pytest
from helpers import by_hand
from helpers.refusals import refused
from helpers.views import VIEWS

import ibdata
from ibdata.environment.replayed import Replay
from ibdata.environment.settings import settings
from ibdata.environment.simulation import Lane, Simulation
from ibdata.errors import UsageError
from ibdata.policies import OBSERVATION

pytestmark = pytest.mark.portable

ACTIONS = [f"act_{name}" for name in ("velocity", "gain", "shift")]
FRAMES = 4


@pytest.fixture(scope="module")
def uniform(describe, tmp_path_factory):
    """A dataset with uniform starts and dynamics of its own, whose setpoints are constant."""
    own = {"base": "paper", "eta_squash": [1.5, 0.5]}
    experiment = describe(start="uniform", dynamics=own, seed=3, output={"latent": "next"})
    return ibdata.generate(experiment, tmp_path_factory.mktemp("uniform") / "data", workers=1)


@pytest.fixture(params=["dataset", "moving", "uniform"])
def played(request):
    return request.getfixturevalue(request.param)


def settings_of(ds, **changes):
    """The settings of an environment with the dynamics of a dataset, but with another start and setpoint."""
    experiment = by_hand.experiment_of(ds)
    setpoint = "drifting" if experiment.drifting else 33
    return settings(**{"setpoint": setpoint, "dynamics": experiment.dynamics, "history": FRAMES, **changes})


def begun(simulation, ds, episode, which=None):
    """Begin episodes; return their noise."""
    replay = Replay.asked_for({"dataset": ds, "episode": episode}, simulation.settings, simulation.n)
    return replay.begin(simulation, simulation.everyone if which is None else np.array(which))


def steps(lane, noise, actions):
    """Play actions (n, 3); yield what each step of the lane returns."""
    for action in actions:
        yield lane.move(tuple(action.tolist()), noise.random_raw(lane.draws))


def columns(frame, prefix, names=OBSERVATION):
    return frame[[f"{prefix}_{name}" for name in names]].to_numpy()


def check_rows(lane, noise, rows):
    """What the lane shows has the bits of the rows; float64 where the dataset has them, else float32."""
    stored, after = (columns(rows, prefix).astype(np.float32) for prefix in ("obs", "next_obs"))
    moved = list(steps(lane, noise, rows[ACTIONS].to_numpy()))
    seen = np.array([seen.reshape(-1, 6) for seen, _, _ in moved])
    np.testing.assert_array_equal(seen[:, 0], after)
    for back in range(1, FRAMES):
        np.testing.assert_array_equal(seen[back - 1 :, back], stored[: len(rows) - back + 1])
    rewards = np.array([reward for _, reward, _ in moved])
    np.testing.assert_array_equal(rewards.astype(rows["reward"].dtype), rows["reward"])
    for name in moved[0][2]:
        hidden = np.array([info[name] for _, _, info in moved])
        np.testing.assert_array_equal(hidden.astype(rows[name].dtype)[:-1], rows[name][1:], err_msg=name)


def test_the_actions_of_an_episode_give_its_rows_bit_for_bit(played):
    frame, lane = played.to_pandas(), Lane(settings_of(played))
    assert len(lane.info()) >= 14
    for episode in range(12):
        rows = frame[frame["episode"] == episode].reset_index(drop=True)
        [noise] = begun(lane, played, episode)
        first = lane.observations().reshape(FRAMES, 6)[0]
        np.testing.assert_array_equal(first, columns(rows, "obs")[0].astype(np.float32))
        for name, value in lane.info().items():
            assert value[0].astype(rows[name].dtype) == rows[name][0]
        check_rows(lane, noise, rows)


@pytest.mark.parametrize("view", VIEWS)
def test_a_replay_through_a_view_shows_its_rows(played, view):
    """After a burn-in, frames of it stand where the dataset, which does not have them, repeats a row."""
    burnt_in = not isinstance(by_hand.experiment_of(played).start, str)
    arrays = played.arrays(history=FRAMES, view=view)
    actions = played.arrays()["actions"].reshape(12, 40, 3)
    for simulation in (Simulation(settings_of(played, view=view), 12), Lane(settings_of(played, view=view))):
        episodes = range(simulation.n) if simulation.n > 1 else [7]
        noises, shown = begun(simulation, played, episodes), {}
        assert ("cost" in view) == ("cost" in simulation.info())
        assert not any(simulation.info().get("cost", []))  # before the first step, which is none itself
        for t in range(40):
            before = simulation.observations()
            slots = 8 + 4 * simulation.settings.world.drifting
            drawn = np.array([noise.random_raw(slots) for noise in noises])
            if isinstance(simulation, Lane):
                seen, reward, info = simulation.move(tuple(actions[7, t].tolist()), drawn[0])
                after, rewards, costs = seen[None], [reward], [info.get("cost")]
            else:
                taken = iter(np.split(drawn.T[None], [8], axis=1))
                draw = lambda *_, taken=taken: next(taken)  # noqa: E731
                rewards = simulation.step(simulation.everyone, actions[:, t], draw)
                after, costs = simulation.observations(), simulation.info().get("cost", [None] * 12)
            shown |= {(e, t): (before[i], after[i], rewards[i], costs[i]) for i, e in enumerate(episodes)}
        rows = [row for row, e in enumerate(arrays["episode"]) if e in episodes]
        assert len(rows) >= 39 * len(episodes)
        for row in rows:
            before, after, reward, cost = shown[arrays["episode"][row], arrays["step"][row]]
            known = arrays["step"][row] + 1 if burnt_in else FRAMES
            for seen, expected, frames in (
                (before, arrays["observations"][row], known),
                (after, arrays["next_observations"][row], known + 1),
            ):
                seen, expected = (x.reshape(FRAMES, -1)[:frames] for x in (seen, expected))
                np.testing.assert_array_equal(seen, expected)
            assert np.float32(reward) == arrays["rewards"][row]
            assert cost == (arrays["costs"][row] if "cost" in view else None)


@pytest.mark.parametrize(
    ("options", "lanes", "message"),
    [
        ({"episode": 3}, 1, "options: found only one of dataset and episode, expected both or neither"),
        ({"episod": 3}, 1, "options: found 'episod'; did you mean 'episode'?"),
        ({"reset_mask": 3}, 1, "options: found 'reset_mask', expected one of dataset, episode"),
        ({"dataset": 3, "episode": 3}, 1, "dataset: found 3, expected a Dataset, or its folder or URL"),
        ({"episode": 12}, 1, "episode: found 12, expected one of 0 to 11"),
        ({"episode": "last"}, 1, "episode: found 'last', expected whole numbers"),
        ({"episode": [1, 2]}, 1, "episode: found 2 episodes, expected one episode"),
        ({"episode": [1, 2]}, 3, "episode: found 2 episodes, expected one episode, or one for each of 3 l"),
    ],
)
def test_options_that_cannot_be_meant_are_one_line(dataset, options, lanes, message):
    given = options if len(options) == 2 or "only one" in message else {"dataset": dataset, **options}
    refused(f"^{re.escape(message)}", Replay.asked_for, given, settings(), lanes)
    assert Replay.asked_for({"reset_mask": np.ones(1, dtype=bool)}, settings(), 1, "reset_mask") is None


def test_settings_of_other_episodes_are_refused(dataset, moving, uniform):
    def refusal(ds, **given):
        with pytest.raises(UsageError) as caught:
            Replay.asked_for({"dataset": ds, "episode": 0}, settings(**given), 1)
        return str(caught.value)

    assert refusal(dataset, setpoint="drifting") == (
        "dataset: found constant setpoints; make the environment with setpoint=a number"
    )
    assert refusal(moving, dynamics="paper") == (
        'dataset: found moving setpoints; make the environment with setpoint="drifting"'
    )
    assert refusal(moving, setpoint="drifting") == (
        "dataset: found the dynamics 'paper'; make the environment with dynamics='paper'"
    )
    own = refusal(uniform).partition("; make the environment with dynamics=")[2]
    assert own == "{'base': 'paper', 'eta_squash': [1.5, 0.5]}"
    Replay.asked_for({"dataset": uniform, "episode": 0}, settings(dynamics=eval(own)), 1)
