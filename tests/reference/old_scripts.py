"""Scripts for the published package, as functions of its classes, and the numbers that they see.

`python -m reference.old_scripts > reference/old_scripts.json`, run in tests/ where the package runs as it is
(Python 3.10 with `numpy==1.23.5 scipy==1.10.1 gym==0.26.2 industrial-benchmark-python==2.0`), writes some
rows of each script.
"""

import json
from itertools import product

import numpy as np

KEPT = (9, 299, 9999)  # the rows in the file
WHEN = 250  # steps of an episode
IDS_SCRIPTS = {  # setpoint, whether it is constant, the largest change that an action proposes
    "IDS, fixed": (70, True, 1.0),
    "IDS, fixed at 100, beyond the range of actions": (100, True, 3.0),
    "IDS, drifting": (50, False, 1.0),
    "IDS, drifting from a bound": (100, False, 1.0),
}
IBGYM_SCRIPTS = {
    f"IBGym, {', '.join(options)}": options
    for options in product(("classic", "delta"), ("discrete", "continuous"), ("classic", "include_past"))
}
NAMES = (*IDS_SCRIPTS, *IBGYM_SCRIPTS)


def rows(name, steps, IDS, IBGym, kind=np.float32):
    """What a script sees in its steps, (steps, numbers). Actions are drawn from NumPy's global generator too.

    `kind` is the type of continuous actions for IBGym: those of its own action space are float32.
    """
    if name in IDS_SCRIPTS:
        return simulated(IDS, steps, *IDS_SCRIPTS[name])
    return played(IBGym, steps, kind, *IBGYM_SCRIPTS[name])


def simulated(IDS, steps, setpoint, is_constant, width):
    """A new simulator after each 500 steps."""
    seen = []
    for step in range(steps):
        if step % (2 * WHEN) == 0:
            ids = IDS(setpoint, is_constant, inital_seed=step + 5)
        action = width * (2 * np.random.rand(3) - 1)
        ids.step(action)
        seen.append([action[0], *ids.visibleState(), *ids.markovState()])
    return np.array(seen)


def played(IBGym, steps, kind, reward_type, action_type, observation_type):
    """Every other episode begins without a call of `reset`."""
    env = IBGym(70, reward_type, action_type, observation_type, WHEN, init_seed=1, n_past_timesteps=4)
    seen = []
    for step in range(steps):
        if step % (2 * WHEN) == 0:
            env.reset()
        action = np.random.randint(27) if action_type == "discrete" else kind(2 * np.random.rand(3) - 1)
        observation, reward, done, info = env.step(action)
        more = (env.reward, env.delta_reward, env.smoothed_reward, env.env_steps, env.init_seed)
        seen.append([np.sum(action), *observation, reward, done, *info.values(), *more])
    return np.array(seen, dtype=np.float64)


def main():
    """Print the rows that the package gives."""
    from industrial_benchmark_python.IBGym import IBGym
    from industrial_benchmark_python.IDS import IDS

    made = {name: rows(name, KEPT[-1] + 1, IDS, IBGym)[list(KEPT)].tolist() for name in NAMES}
    print(json.dumps({"numpy": np.__version__, "rows": made}))


if __name__ == "__main__":
    main()
