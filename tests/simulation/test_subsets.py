"""Any lanes, in any order, give what each gives alone."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata.experiment import Experiment
from ibdata.experiment.rollout import lanes_of
from ibdata.simulation.driver import Run
from ibdata.simulation.variables import record_rows

EPISODES, STEPS = 3, 20
NOISY = {"kind": "gaussian", "base": {"kind": "bad"}, "scale": 0.3}
CASES = {
    "random": {"policies": ["random"]},
    "safe": {"policies": ["safe"], "dynamics": "paper", "setpoints": {"drifting": [0.5, 50, 99.5]}},
    "uniform": {"policies": [NOISY], "start": "uniform"},
    "burn-in": {"policies": ["mediocre"], "start": {"burn_in": [0, 9]}},
    "sticky": {"policies": [{"kind": "sticky", "base": NOISY, "kappa": 0.5}], "start": {"burn_in": [2, 5]}},
    "mixture": {"policies": [{"kind": "mixture", "bases": ["random", "expert"]}]},
    "memory": {"policies": [{"kind": "ornstein_uhlenbeck"}], "setpoints": {"drifting": [1, 2, 3]}},
}


def played(experiment, numbers):
    """What is recorded of these episodes: (variables, steps + 1, n), actions and densities (steps, n, …)."""
    run = Run(experiment.world, lanes_of(experiment, np.array(numbers)))
    rows = record_rows(["setpoint", "fatigue", "consumption", "reward", "theta_3"])
    record = np.empty((len(rows), STEPS + 1, run.n))
    actions, log_prob = np.empty((STEPS, run.n, 3), dtype=np.float32), np.empty((STEPS, run.n))
    for _ in run.play(record, rows, actions, log_prob):
        pass
    return record.transpose(2, 0, 1), actions.swapaxes(0, 1), log_prob.T


@pytest.mark.parametrize("changes", CASES.values(), ids=CASES)
def test_random_subsets_of_lanes_equal_lanes_alone(changes):
    plain = {"name": "x", "setpoints": [0, 30, 70], "episodes": EPISODES, "steps": STEPS}
    experiment = Experiment.model_validate({**plain, **changes})
    total = EPISODES * len(experiment.cells)
    alone = [played(experiment, [number]) for number in range(total)]
    rng = np.random.default_rng(1)
    for _ in range(6):
        numbers = rng.permutation(total)[: rng.integers(1, total + 1)].tolist()
        for kind, together in enumerate(played(experiment, numbers)):
            for number, lane in zip(numbers, together, strict=True):
                assert lane.tobytes() == alone[number][kind][0].tobytes()
