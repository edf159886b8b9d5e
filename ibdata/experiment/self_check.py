"""Small runs with a known result, to check that this machine computes the same bits as all others.

Their states are float64, because float32 would hide a difference in the last bit. The runs use only
the compiled code that every dataset needs.
"""

from __future__ import annotations

import hashlib
import sys
from typing import Any

import numpy as np

from ibdata._simulation.carry import begin
from ibdata._simulation.unroll import unroll
from ibdata.experiment.models import Experiment
from ibdata.experiment.rollout import episodes_of
from ibdata.views.variables import ROWS

KNOWN: dict[str, Any] = {"name": "known", "policies": [{"kind": "random"}], "episodes": 16, "steps": 32}
MOVING = {**KNOWN, "dynamics": "siemens", "setpoints": {"drifting": [1, 35, 70, 99]}, "start": "uniform"}
PRINTED = {**KNOWN, "dynamics": "paper", "setpoints": [1, 99]}
ANSWER = "ce080c3df2a134ce619f7adcddff13a769bfddabe30a0a6c86388358b13ad5d6"


def digest(plain: dict[str, Any]) -> bytes:
    """The SHA-256 of all states of a known run and of its actions, as computed on this machine."""
    known = Experiment.model_validate(plain)
    episodes = episodes_of(known, np.arange(known.episode_count))
    blocks = unroll(episodes, begin(episodes), np.arange(len(ROWS)), known.steps)
    parts = [(block.record[:, 1:].astype("<f8"), block.actions.astype("<f4")) for block in blocks]
    states = np.concatenate([states for states, _ in parts], axis=1)
    actions = np.concatenate([actions for _, actions in parts])
    return hashlib.sha256(states.tobytes() + actions.tobytes()).digest()


def answer() -> str:
    """The SHA-256 of the results of the known runs in this process, and of its treatment of denormals."""
    least = sys.float_info.min
    keeps_denormals = least / 2.0 * 2.0 == least  # a library can tell the processor to treat them as 0
    return hashlib.sha256(digest(MOVING) + digest(PRINTED) + bytes([keeps_denormals])).hexdigest()
