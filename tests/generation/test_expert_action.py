"""The expert's action beside each row."""

from __future__ import annotations

import numpy as np
import pytest

import ibdata
from ibdata._simulation.carry import begin
from ibdata._simulation.unroll import observed
from ibdata.plan.rollout import episodes_of
from ibdata.policies.checked import ask
from ibdata.policies.distributions import applied
from ibdata.policies.expert import Expert

PLAIN = {
    "name": "answers",
    "setpoints": [30, 70],
    "policies": ["random", {"kind": "epsilon_greedy", "epsilon": 0.5, "base": "optimized"}],
    "episodes": 2,
    "steps": 70,  # several blocks
    "start": {"burn_in": [3, 9]},
    "output": {"expert_action": True, "shard_rows": 140},
}
OPTIONS = {
    "burn-in": {},
    "paper": {"dynamics": "paper", "output": {"expert_action": True, "dtype": "float64"}},
    "moving": {"setpoints": "drifting", "start": "uniform"},
}


@pytest.fixture(params=OPTIONS)
def plain(request):
    return PLAIN | OPTIONS[request.param]


def test_it_is_what_an_expert_does_who_watches_the_simulation(plain, tmp_path):
    """The expert is asked step by step in the simulator, which the recorded actions advance."""
    made = ibdata.generate(plain, tmp_path / "x", workers=1)
    arrays = made.arrays()
    experiment, steps = ibdata.load(plain), plain["steps"]
    for number in range(len(made.episodes)):
        rows = arrays["episode"] == number
        episodes = episodes_of(experiment, np.array([number])).played_by(
            Expert(dynamics=plain.get("dynamics", "siemens"))
        )
        carry = begin(episodes)
        for t, action in enumerate(arrays["actions"][rows]):
            [seen] = observed(episodes, carry, t, 1)
            answer, carry.memory = ask(episodes.policy, seen)
            found = arrays["expert_actions"][rows][t]
            np.testing.assert_array_equal(found, applied(answer.sample(np.empty((1, 0))))[0])
            raw, drift = episodes.world.integers(episodes.draw, episodes.lanes, t + 1, 1)
            carry.advance(episodes.world, action.astype(np.float32)[None, None], raw, drift)
        assert t == steps - 1


def test_an_expert_s_own_rows_have_its_actions_twice(plain, tmp_path):
    expert = {"kind": "expert", "dynamics": plain.get("dynamics", "siemens")}
    arrays = ibdata.generate({**plain, "policies": [expert]}, tmp_path / "x", workers=1).arrays()
    np.testing.assert_array_equal(arrays["actions"], arrays["expert_actions"])


def test_it_changes_no_other_column(plain, tmp_path):
    with_answers = ibdata.generate(plain, tmp_path / "with", workers=1)
    without = ibdata.generate(
        plain, tmp_path / "without", overrides={"output.expert_action": False}, workers=1
    )
    rows = with_answers.to_pandas()
    assert rows.columns[-3:].tolist() == ["expert_act_velocity", "expert_act_gain", "expert_act_shift"]
    assert rows.iloc[:, :-3].equals(without.to_pandas())
    assert ibdata.state_at(with_answers, (1, 69)).lanes == 1
