"""The addresses of all random numbers of simulations.

Seed and digest give a key, `stream_key(seed, digest)`, which purpose, index, step and slot complete
(`_numerics/random.py`). Each digest is of a label or of a cell, which has none, so no two are equal:

    random numbers of     seed           digest of                                         index
    datasets              experiment     the cell                                          episode
    evaluated episodes    `evaluate`     "evaluate", the cell; without the policy, if the  episode
                                         numbers are not the policy's own
    branches              `true_values`  "branch", seed, cell, index and step of the row;  branch
                                         the policy, if the numbers are its own
    rollouts              `noise`        "rollout", number among equal starts, values      sample
    starts from settings  `noise`        "rollout", 0, setpoint                            0
    measurements          imperfections  "measurement", or with the name of a variable     episode

In environments and rollouts, the index of a measurement is drawn, unless an episode of a dataset is replayed.
All else that is random in an environment comes from Gymnasium's generators.
"""

from __future__ import annotations

import hashlib
from collections import Counter

import numpy as np
import numpy.typing as npt

Digests = npt.NDArray[np.uint8]  # (n, 32)


def of_starts(values: npt.NDArray[np.float64]) -> Digests:
    """The digests of rollouts from states with these values (variables, n)."""
    equal: Counter[bytes] = Counter()
    digests = []
    for start in map(np.ndarray.tobytes, (values.T + 0.0).astype("<f8")):
        digests.append(hashlib.sha256(b"rollout" + equal[start].to_bytes(8, "little") + start).digest())
        equal[start] += 1
    return np.frombuffer(b"".join(digests), dtype=np.uint8).reshape(-1, 32)
