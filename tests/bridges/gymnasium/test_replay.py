"""The environments replay the episodes of datasets, and begin in given states."""

from __future__ import annotations

import copy
import pickle

import gymnasium
import numpy as np
import pytest

import ibdata
from ibdata.environment import IndustrialBenchmarkEnv, IndustrialBenchmarkVectorEnv
from ibdata.errors import UsageError
from ibdata.policies import OBSERVATION
from ibdata.simulation.variables import hidden

ID = "ibdata/IndustrialBenchmark-v0"
CASES = {
    "constant": ({"setpoints": [20, 70]}, {"setpoint": 33}),
    "uniform, paper": (
        {"setpoints": [0, 100], "dynamics": "paper", "start": "uniform"},
        {"dynamics": "paper", "history": 2},
    ),
    "drifting, burn-in": (
        {"setpoints": {"drifting": [5, 95]}, "start": {"burn_in": [0, 9]}, "seed": 7},
        {"setpoint": "drifting", "history": 3, "start": "uniform"},
    ),
}
STEPS, LANES = 70, 3


@pytest.fixture(params=CASES, scope="module")
def played(request, tmp_path_factory):
    """A dataset, the settings of an environment, and the rows of each episode."""
    experiment, given = CASES[request.param]
    made = ibdata.Experiment(
        name="made",
        policies=["random", "mediocre"],
        episodes=2,
        steps=STEPS,
        output={"latent": True},
        **experiment,
    )
    ds = ibdata.generate(made, tmp_path_factory.mktemp("played") / "data", workers=1)
    frame = ds.to_pandas()
    return ds, given, [rows.reset_index(drop=True) for _, rows in frame.groupby("episode")]


def columns(rows, prefix, names=OBSERVATION):
    return rows[[f"{prefix}_{name}" for name in names]].to_numpy()


def actions_of(rows):
    return columns(rows, "act", ("velocity", "gain", "shift"))


def random_actions(steps=STEPS, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (steps, LANES, 3)).astype(np.float32)


def episode(env, actions):
    """All observations, rewards and hidden states of some steps."""
    return [[x.tolist() if isinstance(x, np.ndarray) else x for x in env.step(action)] for action in actions]


def test_stepping_an_episode_s_actions_gives_its_rows(played):
    ds, given, episodes = played
    env = gymnasium.make(ID, **given)
    for number, rows in enumerate(episodes):
        seen, info = env.reset(options={"dataset": ds, "episode": number})
        obs, after = columns(rows, "obs"), columns(rows, "next_obs")
        names = [f"latent_{name}" for name in hidden("drifting" in given.values())]
        for t, action in enumerate(actions_of(rows)):
            assert seen in env.observation_space
            assert seen[:6].tobytes() == obs[t].tobytes()
            assert list(info) == names
            assert np.float32(list(info.values())).tobytes() == rows[names].to_numpy()[t].tobytes()
            seen, reward, _, _, info = env.step(action)
            assert np.float32(reward) == rows["reward"][t]
            assert seen[:6].tobytes() == after[t].tobytes()
    assert len(episodes) >= 4


def test_other_actions_meet_the_same_noise(played):
    ds, given, episodes = played
    env, rows = gymnasium.make(ID, **given), episodes[-1]
    env.reset(options={"dataset": ds, "episode": len(episodes) - 1})
    seen = np.array([env.step(action)[0][:6] for action in random_actions()[:, 0]])
    after = columns(rows, "next_obs")
    np.testing.assert_array_equal(seen[:, 0], after[:, 0])
    assert (seen[1:, 1:] != after[1:, 1:]).mean() > 0.9


def test_a_plain_reset_goes_back_to_the_generator(played):
    ds, given, _ = played
    env, other = (gymnasium.make(ID, **given) for _ in range(2))
    actions = random_actions()[:, 0]
    env.reset(seed=4, options={"dataset": ds, "episode": 1})
    replayed = episode(env, actions)
    other.reset(seed=5, options={"dataset": ds, "episode": 1})
    assert episode(other, actions) == replayed  # whatever the seed
    env.reset()
    other.reset(seed=4)  # from which the replay took nothing
    fresh = episode(env, actions)
    assert fresh == episode(other, actions)
    assert fresh != replayed


def test_a_given_state_ends_the_replay(played):
    ds, given, _ = played
    env, other = (gymnasium.make(ID, **given).unwrapped for _ in range(2))
    env.reset(seed=4, options={"dataset": ds, "episode": 1})
    other.reset(seed=4, options={"dataset": ds, "episode": 0})
    state = ibdata.state_at(ds, (1, 0))
    for each in (env, other):
        each.set_state(state)
    replayed = gymnasium.make(ID, **given).unwrapped
    replayed.reset(seed=4, options={"dataset": ds, "episode": 1})
    actions = random_actions()[:, 0]
    found = episode(env, actions)
    assert found == episode(other, actions)
    assert found != episode(replayed, actions)


def test_a_refused_replay_leaves_the_episode_as_it_is(played):
    ds, given, episodes = played
    env, other = (gymnasium.make(ID, **given) for _ in range(2))
    for each in (env, other):
        each.reset(seed=1, options={"dataset": ds, "episode": 1})
    with pytest.raises(UsageError, match=f"^episode: found 99, expected one of 0 to {len(episodes) - 1}$"):
        env.reset(seed=2, options={"dataset": ds, "episode": 99})
    with pytest.raises(UsageError, match=r"^episode: found 2 episodes, expected one episode$"):
        env.reset(options={"dataset": ds, "episode": [0, 1]})
    actions = random_actions()[:, 0]
    assert episode(env, actions) == episode(other, actions)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_a_copy_goes_on_with_the_replay_by_itself(played, copied):
    ds, given, episodes = played
    env = IndustrialBenchmarkEnv(**given)
    env.reset(seed=0, options={"dataset": ds, "episode": 2})
    actions = actions_of(episodes[2])
    episode(env, actions[:30])
    other = copied(env)
    rest = episode(env, actions[30:])
    assert episode(other, actions[30:]) == rest
    assert [np.float32(step[1]) for step in rest] == episodes[2]["reward"][30:].tolist()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_lanes_replay_what_single_environments_do(played, mode):
    """Over the end of the episodes, and with lanes that do not replay."""
    ds, given, _ = played
    many = IndustrialBenchmarkVectorEnv(LANES, 50, mode, **given)
    alone = [IndustrialBenchmarkEnv(**given) for _ in range(LANES)]
    seen, _ = many.reset(seed=4, options={"dataset": ds, "episode": [2, 0, 3]})
    asked = [{"dataset": ds, "episode": i} for i in (2, 0, 3)]
    first = [env.reset(seed=4 + i, options=asked[i])[0] for i, env in enumerate(alone)]
    np.testing.assert_array_equal(seen, first)
    for t, actions in enumerate(random_actions(200)):
        begins = t % 50 == 0 and t > 0
        if mode == "Disabled" and begins:
            mask = np.array([True, t != 100, True])
            many.reset(options={"reset_mask": mask})
            if t == 100:  # the second lane replays another episode, the others go on without
                many.reset(options={"reset_mask": ~mask, "dataset": ds, "episode": 1})
        seen, rewards, _, truncated, _ = many.step(actions)
        if mode == "NextStep" and t % 51 == 50:
            np.testing.assert_array_equal(seen, [env.reset()[0] for env in alone])
            continue
        if mode == "Disabled" and begins:
            for i, env in enumerate(alone):
                env.reset(options={"dataset": ds, "episode": 1} if (t, i) == (100, 1) else None)
        steps = [env.step(action) for env, action in zip(alone, actions, strict=True)]
        assert rewards.tolist() == [step[1] for step in steps]
        expected = [step[0] for step in steps]
        if mode == "SameStep" and truncated.all():
            expected = [env.reset()[0] for env in alone]
        np.testing.assert_array_equal(seen, expected)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_a_copy_of_the_lanes_goes_on_with_the_replay_by_itself(played, copied):
    ds, given, _ = played
    many = IndustrialBenchmarkVectorEnv(LANES, **given)
    many.reset(seed=0, options={"dataset": ds, "episode": [0, 1, 2]})
    actions = random_actions(100)
    for action in actions[:10]:
        many.step(action)
    other = copied(many)
    rewards = [many.step(action)[1].tolist() for action in actions[10:]]
    assert [other.step(action)[1].tolist() for action in actions[10:]] == rewards


def test_lanes_begin_in_given_states_as_single_environments_do(played):
    ds, given, _ = played
    many = IndustrialBenchmarkVectorEnv(LANES, 5, "Disabled", **given)
    alone = [IndustrialBenchmarkEnv(**given) for _ in range(LANES)]
    many.reset(seed=4, options={"dataset": ds, "episode": 0})
    for i, env in enumerate(alone):
        env.reset(seed=4 + i, options={"dataset": ds, "episode": 0})
    for actions in random_actions(5):
        many.step(actions)
        for env, action in zip(alone, actions, strict=True):
            env.step(action)
    episodes, steps = [3, 1, 2], [7, 60, 0]
    some = many.set_state(ibdata.state_at(ds, (episodes[:2], steps[:2])), lanes=[2, 0])
    rest = many.set_state(ibdata.state_at(ds, (episodes[2], steps[2])), lanes=1)
    for (seen, info), lanes in ((some, [0, 2]), (rest, [1])):
        for lane in lanes:
            row = {2: 0, 0: 1, 1: 2}[lane]
            own, hidden_state = alone[lane].set_state(ibdata.state_at(ds, (episodes[row], steps[row])))
            np.testing.assert_array_equal(seen[lane], own)
            assert info["latent_mu_v"][lane] == hidden_state["latent_mu_v"]
        assert np.flatnonzero(info["_latent_mu_v"]).tolist() == lanes
    for actions in random_actions(5, seed=1):
        found = many.step(actions)
        expected = [env.step(action) for env, action in zip(alone, actions, strict=True)]
        np.testing.assert_array_equal(found[0], [step[0] for step in expected])
    assert found[3].all()  # the steps are counted from the state


def test_all_lanes_may_begin_in_states_without_a_reset(played):
    ds, given, _ = played
    many = IndustrialBenchmarkVectorEnv(LANES, **given)
    seen, _ = many.set_state(ibdata.state_at(ds, ([0, 1, 2], 5)))
    np.testing.assert_array_equal(
        seen[:, :6], columns(ds.to_pandas().query("step == 5 and episode < 3"), "obs")
    )
    many.step(random_actions()[0])
