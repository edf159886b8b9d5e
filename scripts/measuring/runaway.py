"""Measure when the fatigue runs away under uniform random actions, for the README and docs/errata.md."""

from typing import Any

import numpy as np

from ibdata import Experiment
from ibdata.simulation.rollout import rollout

EPISODES, STEPS, SETPOINTS = 2000, 1000, (10, 50, 100)
START, CAP = 1.2, 5.0


def runaway(dynamics: Any, setpoint: float) -> tuple[float, float, float]:
    """Median first step with max(μ) >= 1.2; percent of episodes without; percent of steps at the cap."""
    experiment = Experiment.model_validate(
        {
            "name": "runaway",
            "dynamics": dynamics,
            "setpoints": setpoint,
            "policies": [{"kind": "random"}],
            "episodes": EPISODES,
            "steps": STEPS,
            "output": {"latent": "next"},
        }
    )
    columns = rollout(experiment, 0, EPISODES)
    mu_v, mu_g = (columns.table[columns.names.index(f"next_latent_mu_{x}")] for x in "vg")
    mu = np.maximum(mu_v, mu_g).reshape(EPISODES, STEPS)
    above = mu >= np.float32(START)
    first = np.where(above.any(axis=1), above.argmax(axis=1) + 1.0, np.inf)
    return float(np.median(first)), 100 * float(np.mean(np.isinf(first))), 100 * float(np.mean(mu == CAP))
