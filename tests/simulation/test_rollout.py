"""A rollout equals a plain simulation with noise from the documented addresses, in blocks of any size."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import by_hand
from helpers.policies import action_of, log_density_of

from ibdata._simulation.kernel import scatter_columns
from ibdata._simulation.unroll import BLOCK
from ibdata.dynamics import initial_state, step
from ibdata.experiment import Experiment
from ibdata.plan.rollout import rollout

DYNAMICS, DRIFT, POLICY, START, BURN_IN_DYNAMICS, BURN_IN_DRIFT, BURN_IN_POLICY = range(7)
OBSERVATION = ("setpoint", "velocity", "gain", "shift", "fatigue", "consumption")
DERIVED = (
    "convolved_cost", "penalty", "expected_consumption", "effective_shift", "effective_velocity",
    "effective_gain", "alpha", "basic_fatigue",
)  # fmt: skip
CONSTANT, MOVING = [0.0, 33.0, 100.0], {"drifting": [0.5, 50.0, 99.5]}
STEPS = 30


def described(**changes):
    plain = {
        "name": "tested",
        "setpoints": CONSTANT,
        "policies": [{"kind": "random"}, {"kind": "safe"}],
        "episodes": 2,
        "steps": STEPS,
        "output": {"dtype": "float64"},
    }
    return Experiment.model_validate({**plain, **changes})


def played(experiment, first=0, stop=None):
    """The columns of episodes by name, each (episodes, steps)."""
    stop = len(experiment.cells) * experiment.episodes if stop is None else stop
    made = rollout(experiment, first, stop)
    return {
        name: x.reshape(stop - first, experiment.steps)
        for name, x in zip(made.names, made.table, strict=True)
    }


def assert_same(a, b):
    assert list(a) == list(b)
    for name in a:
        assert a[name].tobytes() == b[name].tobytes(), name


# --- the second simulation


def uniform(experiment, cell, index, purpose, t, slots):
    """The uniforms (slots,) at an address."""
    return np.array(by_hand.uniforms_at(experiment.seed, cell.digest, index, purpose, t, slots))


def noise(experiment, cell, index, t, *purposes):
    return by_hand.noise(
        experiment.seed, cell.digest, index, t, experiment.drifting, purposes or (DYNAMICS, DRIFT)
    )


def started(experiment, cell, index):
    """The states up to that in which the first recorded observation is made, and the actions between them."""
    u = uniform(experiment, cell, index, START, 0, 4)
    steerings = 100.0 * u[:3] if experiment.start == "uniform" else np.full(3, 50.0)
    state = initial_state(cell.setpoint, *steerings, drifting=experiment.drifting)
    state = step(state, np.zeros((1, 3)), noise(experiment, cell, index, 0), experiment.scenario.variant)
    states, actions = [state], []
    if isinstance(experiment.start, str):
        return states, actions
    low, high = experiment.start.burn_in
    for t in range(low + int((high - low + 1) * u[0])):
        action = 2.0 * uniform(experiment, cell, index, BURN_IN_POLICY, t, 4)[:3] - 1.0
        drawn = noise(experiment, cell, index, t, BURN_IN_DYNAMICS, BURN_IN_DRIFT)
        actions.append(action.astype(np.float32))
        states.append(step(states[-1], actions[-1][None], drawn, experiment.scenario.variant))
    return states, actions


def history(states, length):
    """The last observations (1, length, 6), newest first; before the first one, that one."""
    last = [states[max(0, len(states) - 1 - k)] for k in range(length)]
    seen = [[getattr(state, name)[0] for name in OBSERVATION] for state in last]
    return np.array(seen, dtype=np.float32).reshape(1, length, 6)


def resimulated(experiment, cell, index):
    """States 0 … steps, actions (steps, 3) and their log densities (steps,) of one episode."""
    states, actions = started(experiment, cell, index)
    skipped, log_prob = len(actions), []
    for t in range(experiment.steps):
        u = uniform(experiment, cell, index, POLICY, t, -(-cell.policy.needs.draws // 4) * 4)
        seen = history(states, cell.policy.needs.history)
        action = action_of(cell.policy, seen, u[None, : cell.policy.needs.draws])
        log_prob.append(log_density_of(cell.policy, seen, action)[0])
        actions.append(action[0])
        states.append(
            step(states[-1], action, noise(experiment, cell, index, t + 1), experiment.scenario.variant)
        )
    return states[skipped:], np.array(actions[skipped:]), np.array(log_prob)


def expected_latents(states, experiment, prefix):
    hidden = {f"theta_{lag}": [s.operational_cost[0, 9 - lag] for s in states] for lag in range(1, 10)}
    names = ["domain", "response", "direction", "mu_v", "mu_g"]
    names += ["drift_rate", "drift_left"] if experiment.drifting else []
    hidden |= {name: [getattr(s, name)[0] for s in states] for name in names}
    return {f"{prefix}{name}": values for name, values in hidden.items()}


def expected_columns(experiment, cell, index):
    """Float columns (steps,) by name, from the words of the documentation."""
    states, actions, log_prob = resimulated(experiment, cell, index)
    now, after = states[:-1], states[1:]
    made = {f"obs_{name}": [getattr(s, name)[0] for s in now] for name in OBSERVATION}
    made |= {f"act_{name}": actions[:, j] for j, name in enumerate(("velocity", "gain", "shift"))}
    made["reward"] = [s.reward[0] for s in after]
    made |= {f"next_obs_{name}": [getattr(s, name)[0] for s in after] for name in OBSERVATION}
    if experiment.output.latent:
        made |= expected_latents(now, experiment, "latent_")
    if experiment.output.latent == "full":
        made |= {f"latent_{name}": [getattr(s, name)[0] for s in now] for name in DERIVED}
    if experiment.output.latent == "next":
        made |= expected_latents(after, experiment, "next_latent_")
    made["action_log_prob"] = log_prob
    return {name: np.array(x, dtype=experiment.output.dtype) + 0.0 for name, x in made.items()}


def assert_resimulated(experiment):
    found = played(experiment)
    for i in range(len(experiment.cells) * experiment.episodes):
        cell, index = experiment.cells[i // experiment.episodes], i % experiment.episodes
        assert_same({name: x[i] for name, x in found.items()}, expected_columns(experiment, cell, index))


REPLACED = {"base": "siemens", "alpha_threshold": 1.2}


@pytest.mark.parametrize(
    ("dynamics", "setpoints", "start", "latent"),
    [
        ("siemens", CONSTANT, "default", False),
        ("siemens", MOVING, "uniform", True),
        ("siemens", CONSTANT, {"burn_in": [0, 4]}, "full"),
        ("paper", MOVING, {"burn_in": [0, 4]}, "full"),
        ("paper", CONSTANT, "uniform", "next"),
        ("paper", MOVING, "default", True),
        (REPLACED, MOVING, {"burn_in": [0, 0]}, "next"),
        (REPLACED, CONSTANT, "uniform", "full"),
    ],
)
def test_every_value_is_that_of_a_plain_simulation(dynamics, setpoints, start, latent):
    output = {"dtype": "float64", "latent": latent}
    assert_resimulated(described(dynamics=dynamics, setpoints=setpoints, start=start, output=output))


@pytest.mark.parametrize("burn_in", [[0, 4], [9, 9]])
def test_a_policy_sees_the_observations_of_its_burn_in(burn_in):
    """Not its first recorded one repeated; before the burn-in, the first one of all."""
    greedy = {"kind": "epsilon_greedy", "base": {"kind": "optimized"}, "epsilon": 0.2}
    policies = [{"kind": "optimized"}, greedy]
    assert_resimulated(described(policies=policies, setpoints=[33.0], start={"burn_in": burn_in}))


# --- what an episode does not depend on

WIDE = described(setpoints=MOVING, start={"burn_in": [1, 3]}, episodes=7, output={"latent": "full"})


@pytest.fixture(scope="module")
def usual():
    return played(WIDE)


@pytest.mark.parametrize(
    ("changes", "episodes"),
    [
        ({"steps": 2}, range(42)),
        ({"episodes": 3}, [i for i in range(42) if i % 7 < 3]),
        (
            {"name": "other", "setpoints": {"drifting": [50]}, "policies": [{"kind": "safe", "name": "b"}]},
            range(28, 35),
        ),
        ({"output": {"dtype": "float32", "latent": "full"}}, range(42)),
    ],
    ids=["fewer steps", "fewer episodes", "fewer cells, other names", "float32"],
)
def test_an_episode_does_not_depend_on_the_rest(usual, changes, episodes):
    plain = WIDE.model_dump(mode="json", exclude_none=True)
    found = played(Experiment.model_validate({**plain, **changes}))
    for name, x in usual.items():
        same = x[list(episodes), : found[name].shape[1]].astype(found[name].dtype)
        assert same.tobytes() == found[name].tobytes(), name


def test_the_length_of_a_run_compiles_nothing_anew():
    """Whether or not the last block is a whole one."""
    if not hasattr(scatter_columns, "signatures"):
        pytest.skip("it is plain Python here")
    made = []
    for steps in (BLOCK, BLOCK + 1):
        rollout(described(steps=steps), 0, 1)
        made.append(set(scatter_columns.signatures))
    assert made[0] == made[1]
