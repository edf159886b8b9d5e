"""The authors' class `IDS`, run with given random numbers instead of its own draws."""

from __future__ import annotations

import contextlib
import warnings

import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # the sources have invalid escapes
    from industrial_benchmark_python.IDS import IDS

SAME = {  # field of State: key of the published state
    "setpoint": "p",
    "velocity": "v",
    "gain": "g",
    "shift": "h",
    "consumption": "c",
    "fatigue": "f",
    "reward": "reward",
    "operational_cost": "o",
    "domain": "gs_domain",
    "response": "gs_sys_response",
    "direction": "gs_phi_idx",
    "mu_v": "hv",
    "mu_g": "hg",
    "convolved_cost": "oc",
    "effective_shift": "he",
    "effective_velocity": "ve",
    "effective_gain": "ge",
    "basic_fatigue": "fb",
}


class Reader:
    """The functions of `np.random` that `IDS` calls. They read the noise of one step instead of drawing.

    `IDS` calls `rand` for several purposes, in this order: the rate of a new segment and whether it is zero,
    right after the length of the segment; the flip; after both exponentials, the uniforms of gain and
    velocity.
    """

    def load(self, row):
        """Take the numbers of the next step, by the names of ibdata's `Noise`."""
        self.row = row
        self.segment = []
        self.exponentials = [row["exp_g"], row["exp_v"]]
        self.draws = [row["uniform_g"], row["uniform_v"]]
        self.binomials = [row["bernoulli_g"], row["bernoulli_v"]]
        self.last = [-row["normal_consumption"]]  # IDS subtracts it

    def check_all_read(self):
        """Check that the step has used all numbers. (A draw beyond them raises IndexError.)"""
        left = [*self.segment, *self.exponentials, *self.draws, *self.binomials, *self.last]
        assert left == []

    def seed(self, seed):
        return None

    def randint(self, low, high):
        self.segment = [self.row["uniform_drift_rate"], self.row["uniform_drift_zero"]]
        return low + int((high - low) * self.row["uniform_drift_length"])

    def rand(self):
        if self.segment:
            return self.segment.pop(0)
        if self.exponentials:
            return 1.0 - self.row["uniform_drift_flip"]  # IDS flips above one half, ibdata below
        return self.draws.pop(0)

    def exponential(self, scale):
        return scale * self.exponentials.pop(0)

    def binomial(self, n, p):
        assert n == 1
        return int(self.binomials.pop(0) < p)

    def normal(self, mean, sd):
        return mean + sd * self.row["normal_alpha"]

    def randn(self):
        return self.last.pop(0)


DRAWS = ("seed", "randint", "rand", "exponential", "binomial", "normal", "randn")


@contextlib.contextmanager
def replaced_draws():
    """Replace numpy's global draws by a `Reader`, and add `np.float`, which IDS needs, during the block."""
    reader = Reader()
    before = {name: getattr(np.random, name) for name in DRAWS}
    had_float = "float" in vars(np)
    try:
        if not had_float:
            np.float = float  # noqa: NPY001
        for name in DRAWS:
            setattr(np.random, name, getattr(reader, name))
        yield reader
    finally:
        for name, function in before.items():
            setattr(np.random, name, function)
        if not had_float:
            del np.float  # noqa: NPY001


def run(setpoint, drifting, actions, noise):
    """All states of one lane as a dict of arrays (steps, ...), with the names of ibdata's `State`.

    Args:
        setpoint: The setpoint at the start.
        drifting: Whether it moves.
        actions: (steps, 3). The first is zero, because the constructor of `IDS` makes that step.
        noise: One dict per step, as `Reader.load` takes it.
    """
    assert not actions[0].any()
    states = {name: [] for name in SAME}
    states |= {"drift_rate": [], "drift_left": [], "penalty": []}
    with replaced_draws() as reader:
        reader.load(noise[0])
        ids = IDS(p=float(setpoint), stationary_p=not drifting)
        for t in range(len(noise)):
            if t > 0:
                reader.load(noise[t])
                ids.step(actions[t])
            reader.check_all_read()
            for name, key in SAME.items():
                states[name].append(np.array(ids.state[key], dtype=np.float64))
            states["drift_rate"].append(ids._p_ch if drifting else 0.0)
            states["drift_left"].append(ids._p_steps - ids._p_step if drifting else -1)
            states["penalty"].append(-float(ids.state["MC"]))
    found = {name: np.array(values, dtype=np.float64) for name, values in states.items()}
    found["expected_consumption"] = found["convolved_cost"] + 25.0 * (found["penalty"] + 1.0)
    fatigued = found["basic_fatigue"] > 0.0  # otherwise alpha does not follow from the published state
    found["alpha"] = np.full(len(noise), np.nan)
    ratio = found["fatigue"][fatigued] / found["basic_fatigue"][fatigued]
    found["alpha"][fatigued] = (3.0 * ratio - 1.0) / 2.0
    return found
