"""The environments replay the episodes of datasets, and begin in given states."""

import numpy as np
import pytest

import ibdata
from ibdata.environment import IndustrialBenchmarkEnv, IndustrialBenchmarkVectorEnv

pytestmark = pytest.mark.portable

ID = "ibdata/IndustrialBenchmark-v0"
CASES = {
    "uniform, paper": (
        {"setpoints": [0, 100], "dynamics": "paper", "start": "uniform"},
        {"dynamics": "paper", "history": 2},
    ),
    "drifting, burn-in": (
        {"setpoints": {"drifting": [5, 95]}, "start": {"burn_in": [0, 9]}, "seed": 7},
        {"setpoint": "drifting", "history": 3, "start": "uniform"},
    ),
}
LANES = 3


@pytest.fixture(params=CASES, scope="module")
def played(request, tmp_path_factory):
    """A dataset, and the settings of an environment."""
    experiment, given = CASES[request.param]
    plain = {"name": "made", "policies": ["random", "mediocre"], "episodes": 2, "steps": 70, **experiment}
    return ibdata.generate(plain, tmp_path_factory.mktemp("played") / "data", workers=1), given


def random_actions(steps):
    return np.random.default_rng(0).uniform(-1, 1, (steps, LANES, 3)).astype(np.float32)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_lanes_replay_what_single_environments_do(played, mode):
    """Over the end of the episodes, after which only the second lane replays again, where that is asked."""
    ds, given = played
    many = IndustrialBenchmarkVectorEnv(LANES, 50, mode, **given)
    alone = [IndustrialBenchmarkEnv(**given) for _ in range(LANES)]
    numbers = [2, 0, 3]
    seen, _ = many.reset(seed=4, options={"dataset": ds, "episode": numbers})
    for i, env in enumerate(alone):
        first, _ = env.reset(seed=4 + i, options={"dataset": ds, "episode": numbers[i]})
        np.testing.assert_array_equal(seen[i], first)
    again = {"dataset": ds, "episode": 1}
    actions = iter(random_actions(120))
    for _ in range(2):
        for _ in range(50):
            action = next(actions)
            seen, rewards, _, truncated, _ = many.step(action)
            steps = [env.step(each) for env, each in zip(alone, action, strict=True)]
            assert rewards.tolist() == [step[1] for step in steps]
            if not (mode == "SameStep" and truncated.all()):
                np.testing.assert_array_equal(seen, [step[0] for step in steps])
        assert truncated.all()
        if mode == "NextStep":
            seen, *_ = many.step(next(actions))
        if mode == "Disabled":
            second = np.array([False, True, False])
            many.reset(options={"reset_mask": ~second})
            seen, _ = many.reset(options={"reset_mask": second, **again})
        for i, env in enumerate(alone):
            first, _ = env.reset(options=again if mode == "Disabled" and i == 1 else None)
            np.testing.assert_array_equal(seen[i], first)


def test_lanes_begin_in_given_states_as_single_environments_do(played):
    """The steps of an episode are counted from the state."""
    ds, given = played
    many = IndustrialBenchmarkVectorEnv(LANES, 5, "Disabled", **given)
    alone = [IndustrialBenchmarkEnv(**given) for _ in range(LANES)]
    many.reset(seed=4, options={"dataset": ds, "episode": 0})
    for i, env in enumerate(alone):
        env.reset(seed=4 + i, options={"dataset": ds, "episode": 0})
    for actions in random_actions(5):
        many.step(actions)
        for env, action in zip(alone, actions, strict=True):
            env.step(action)
    rows = {0: (1, 60), 1: (2, 0), 2: (3, 7)}  # lane: episode and step
    for lanes in ([2, 0], [1]):
        places = [rows[lane] for lane in lanes]
        seen, info = many.set_state(ibdata.state_at(ds, np.array(places)), lanes)
        for lane in lanes:
            own, hidden_state = alone[lane].set_state(ibdata.state_at(ds, rows[lane]))
            np.testing.assert_array_equal(seen[lane], own)
            assert info["latent_mu_v"][lane] == hidden_state["latent_mu_v"]
        assert np.flatnonzero(info["_latent_mu_v"]).tolist() == sorted(lanes)
    for actions in random_actions(5):
        found = many.step(actions)
        expected = [env.step(action)[0] for env, action in zip(alone, actions, strict=True)]
        np.testing.assert_array_equal(found[0], expected)
    assert found[3].all()
