"""The authors' `IDS`, fed with given random numbers in place of its own draws."""

from __future__ import annotations

import contextlib
import warnings

import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter(
        "ignore"
    )  # the sources hold invalid escapes, an error in newer Pythons' strict mode
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
    """The functions of `np.random` that `IDS` calls, reading the noise of one step instead of drawing.

    `IDS` calls `rand` for four purposes. In a step, the calls come in this order: rate and zero right after
    the length of a new segment; the flip; after both exponentials, the uniforms of gain and velocity.
    """

    def load(self, row):
        """Take the numbers of the next step: a dict from the names of ibdata's `Noise` to numbers."""
        self.row = row
        self.segment = []
        self.exponentials = [row["exp_g"], row["exp_v"]]
        self.uniforms = [row["uniform_g"], row["uniform_v"]]
        self.binomials = [row["bernoulli_g"], row["bernoulli_v"]]
        self.last = [-row["normal_consumption"]]  # IDS subtracts it

    def check_all_read(self):
        """Every draw that each step makes was made; one more than given raises IndexError on its own."""
        left = [*self.segment, *self.exponentials, *self.uniforms, *self.binomials, *self.last]
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
        return self.uniforms.pop(0)

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
    """A `Reader` in place of the global generator, and `np.float`, which IDS needs; all restored after."""
    reader = Reader()
    before = {name: getattr(np.random, name) for name in DRAWS}
    had_float = "float" in vars(np)
    try:
        if not had_float:
            np.float = float  # noqa: NPY001 - the point of it
        for name in DRAWS:
            setattr(np.random, name, getattr(reader, name))
        yield reader
    finally:
        for name, function in before.items():
            setattr(np.random, name, function)
        if not had_float:
            del np.float  # noqa: NPY001


def run(setpoint, drifting, actions, noise):
    """Every state of one lane as a dict of arrays (steps, ...), named as ibdata's `State`.

    actions (steps, 3), the first of which is the constructor's own: zeros; noise: a list of one dict a step.
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
    fatigued = found["basic_fatigue"] > 0.0  # elsewhere alpha cannot be told from the published state
    found["alpha"] = np.full(len(noise), np.nan)
    ratio = found["fatigue"][fatigued] / found["basic_fatigue"][fatigued]
    found["alpha"][fatigued] = (3.0 * ratio - 1.0) / 2.0
    return found
