"""Small runs with known results, to check that this machine computes the same bits as all others.

Their columns are float64, because float32 would hide a difference in the last bit.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping
from typing import Any

from ibdata.experiment import Experiment
from ibdata.simulation.rollout import rollout

EXPERIMENT = {
    "name": "known-answer",
    "dynamics": "siemens",
    "setpoints": {"drifting": [1, 35, 70, 99]},
    "policies": [{"kind": "safe"}],
    "episodes": 16,
    "steps": 32,
    "start": "uniform",
    "output": {"dtype": "float64", "latent": "full"},
}
SHA256 = "05152e81029575167919b932164a0673d9d85df4ed3f67c016298336503d6b18"
# The other dynamics, and the policies that draw random numbers or compute densities.
OTHERS = {
    "name": "known-policies",
    "dynamics": "paper",
    "setpoints": [1, 99],
    "policies": [
        {"kind": "random"},
        {"kind": "gaussian", "base": {"kind": "constant", "action": [0.5, -0.5, 0.0]}, "scale": 0.5},
        {"kind": "epsilon_greedy", "base": {"kind": "constant"}, "epsilon": 0.5},
    ],
    "episodes": 2,
    "steps": 32,
    "output": {"dtype": "float64", "latent": "full"},
}
OTHERS_SHA256 = "f8ab653936c66fcfc71db7acad488d3bf5d83f188a4a565198c57e5a8a546911"


def digest(experiment: Mapping[str, Any] = EXPERIMENT) -> str:
    """The SHA-256 of a known run's columns, as computed on this machine."""
    known = Experiment.model_validate(experiment)
    episodes = len(known.cells) * known.episodes
    return hashlib.sha256(rollout(known, 0, episodes).table.astype("<f8").tobytes()).hexdigest()


def keeps_denormals(least: float = sys.float_info.min) -> bool:
    """Whether the processor keeps denormal numbers, which it treats as 0 if a library tells it to."""
    return least / 2.0 * 2.0 == least


def answer() -> str:
    """The SHA-256 of all that this process computes of the known runs, and of what it does with denormals."""
    return _hashed(digest(), digest(OTHERS), keeps_denormals())


def is_right(found: str) -> bool:
    """Whether this is the `answer` of a machine that computes the same bits as all others."""
    return found == _hashed(SHA256, OTHERS_SHA256, True)


def matches() -> bool:
    """Whether this process computes the known runs bit for bit, and keeps denormal numbers."""
    return is_right(answer())


def _hashed(first: str, others: str, denormals: bool) -> str:
    return hashlib.sha256(f"{first} {others} {denormals}".encode()).hexdigest()
