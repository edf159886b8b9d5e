"""Replay saved tapes with the `ibdata` that comes first on the path, and print the differences.

`python -m helpers.replay tape.npz …` prints one JSON object: the file of the package and, for each field of
`State`, the largest |difference| / max(1, |value|) from the saved states of all tapes, or null for NaN.
"""

from __future__ import annotations

import json
import math
import sys

import numpy as np

import ibdata.dynamics
from helpers import tapes


def save(path, tape, states):
    """Save a tape and the states that are expected on it, for `load`."""
    arrays = {f"noise_{name}": x for name, x in tape.noise._asdict().items()}
    arrays |= {f"state_{name}": x for name, x in states.items()}
    np.savez(path, setpoint=tape.setpoint, drifting=tape.drifting, action=tape.action, **arrays)


def load(path):
    """Load a tape and its expected states."""
    with np.load(path, allow_pickle=False) as file:
        noise = tapes.Noise(*(file[f"noise_{name}"] for name in tapes.Noise._fields))
        states = {name: file[f"state_{name}"] for name in tapes.FIELDS}
        return tapes.Tape(file["setpoint"], bool(file["drifting"]), file["action"], noise), states


def main(paths):
    """Replay the tapes and print the JSON object."""
    worst = dict.fromkeys(tapes.FIELDS, 0.0)
    for path in paths:
        tape, expected = load(path)
        for name, x in tapes.differences(tapes.run_ibdata(tape, "siemens"), expected).items():
            worst[name] = x if math.isnan(x) else max(worst[name], x)
    found = {name: None if math.isnan(x) else x for name, x in worst.items()}
    print(json.dumps({"file": ibdata.dynamics.__file__, "worst": found}))


if __name__ == "__main__":
    main(sys.argv[1:])
