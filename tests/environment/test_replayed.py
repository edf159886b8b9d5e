"""The lanes of an environment replay the episodes of datasets, without Gymnasium."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from helpers import by_hand
from helpers.policies import Watching

import ibdata
from ibdata.environment.replayed import Noise, Replay
from ibdata.environment.settings import settings
from ibdata.environment.simulation import Lane, Simulation
from ibdata.errors import UsageError
from ibdata.evaluation.states import Source
from ibdata.numerics.random import Purpose, integers
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


def test_the_first_observations_are_those_of_the_burn_in(played):
    expected = Source(played.stored).carries_at(
        np.arange(12), np.zeros(12, dtype=int), Watching(frames=FRAMES)
    )
    lane, many = Lane(settings_of(played)), Simulation(settings_of(played), 12)
    begun(many, played, range(12))
    np.testing.assert_array_equal(many.carry.observations, expected.observations)
    for episode in range(12):
        begun(lane, played, episode)
        np.testing.assert_array_equal(lane.carry.observations[0], expected.observations[episode])
    differing = (many.carry.observations[:, 0] != many.carry.observations[:, -1]).any(axis=1)
    assert differing.sum() >= 8 or played.manifest["experiments"][0]["start"] in ("default", "uniform")


@pytest.mark.parametrize(
    "view",
    [
        {"observe": "markov", "reward_scale": 0.01, "cost": "runaway"},
        {"observe": ["latent_mu_g", "obs_fatigue"], "reward": {"consumption": 1, "fatigue": 1}},
        {
            "actions": True,
            "cost": {"fatigue": 40},
            "reward": "delta",
            "reward_scale": 0.1,
            "imperfections": {
                "delay": {"obs_fatigue": 3},
                "noise": {"obs_consumption": 5.0},
                "missing": {"obs_consumption": 0.3, "obs_gain": 0.1},
                "mask": True,
                "seed": 4,
            },
        },
    ],
)
def test_a_replay_through_a_view_shows_its_rows(played, view):
    arrays = played.arrays(history=FRAMES, view=view)
    actions = played.arrays()["actions"].reshape(12, 40, 3)
    for simulation in (Simulation(settings_of(played, view=view), 12), Lane(settings_of(played, view=view))):
        episodes = range(simulation.n) if simulation.n > 1 else [7]
        noises, shown = begun(simulation, played, episodes), {}
        assert ("cost" in view) == ("cost" in simulation.info())
        assert not any(simulation.info().get("cost", []))  # before the first step, which is none itself
        for t in range(40):
            before = simulation.observations()
            drawn = np.array(
                [noise.random_raw(8 + 4 * simulation.settings.world.drifting) for noise in noises]
            )
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
            np.testing.assert_array_equal(before, arrays["observations"][row])
            np.testing.assert_array_equal(after, arrays["next_observations"][row])
            assert np.float32(reward) == arrays["rewards"][row]
            assert cost == (arrays["costs"][row] if "cost" in view else None)


def test_the_noise_goes_on_after_the_end_of_the_episode(describe, tmp_path):
    """A longer dataset of the same cells has the same rows first."""
    short, long = (
        ibdata.generate(describe(steps=n, start="uniform"), tmp_path / str(n), workers=1) for n in (10, 150)
    )
    lane, rows = Lane(settings_of(short)), long.to_pandas().query("episode == 5").reset_index(drop=True)
    check_rows(lane, *begun(lane, short, 5), rows)


def test_the_other_lanes_stay_as_they_are(dataset):
    many = Simulation(settings_of(dataset), 3)
    begun(many, dataset, [1, 2, 3])
    before = many.observations()
    [noise] = begun(many, dataset, [7, 8, 9], which=[1])
    after, alone = many.observations(), Simulation(settings_of(dataset), 1)
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    [other] = begun(alone, str(dataset.path), 8)  # named by its folder
    np.testing.assert_array_equal(after[1], alone.observations()[0])
    np.testing.assert_array_equal(noise.random_raw(9), other.random_raw(9))


@pytest.mark.parametrize("drifting", [False, True])
def test_integers_come_in_the_order_of_the_steps(drifting):
    key, index = np.array([3, 2**63], dtype=np.uint64), 5
    parts = [
        integers(key[None], np.array([index]), purpose, 1, 300, slots)[:, :, 0]
        for purpose, slots in [(Purpose.DYNAMICS, 8), (Purpose.DRIFT, 4)][: 1 + drifting]
    ]
    expected = np.hstack(parts).ravel()
    for counts in ([8] * 100, [512] * 4, [1, 700, 30, 512, 2]):
        noise = Noise(index, key, drifting)
        taken = np.concatenate([noise.random_raw(count) for count in counts])
        np.testing.assert_array_equal(taken, expected[: len(taken)])
        for other in (copy.deepcopy(noise), pickle.loads(pickle.dumps(noise))):
            np.testing.assert_array_equal(other.random_raw(8), expected[len(taken) :][:8])


@pytest.mark.parametrize(
    ("options", "lanes", "message"),
    [
        ({"dataset": "data"}, 1, "options: found only one of dataset and episode, expected both or neither"),
        ({"episode": 3}, 1, "options: found only one of dataset and episode, expected both or neither"),
        ({"dataset": 3, "episode": 3}, 1, "dataset: found 3, expected a Dataset, or its folder or URL"),
        ({"episode": 12}, 1, "episode: found 12, expected one of 0 to 11"),
        ({"episode": "last"}, 1, "episode: found 'last', expected whole numbers"),
        ({"episode": [1, 2]}, 1, "episode: found 2 episodes, expected one episode"),
        (
            {"episode": [1, 2]},
            3,
            "episode: found 2 episodes, expected one episode, or one for each of 3 lanes",
        ),
    ],
)
def test_options_that_cannot_be_meant_are_one_line(dataset, options, lanes, message):
    given = options if len(options) == 2 or "only one" in message else {"dataset": dataset, **options}
    with pytest.raises(UsageError) as caught:
        Replay.asked_for(given, settings(), lanes)
    assert str(caught.value).startswith(message)
    assert Replay.asked_for({"reset_mask": np.ones(1, dtype=bool)}, settings(), 1) is None


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
