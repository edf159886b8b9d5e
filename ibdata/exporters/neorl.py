"""An NPZ for NeoRL's loader: obs, next_obs, action, reward (N, 1), done (N, 1) and index, for one setpoint.
The history is 30 by default, which gives 180 columns, newest frame first. `done` also marks the time limit,
as in NeoRL's own files. `index` holds the ends of the episodes, because the loader puts a 0 in front of it.
The loader reads it as float32, so more than 16,777,216 rows are refused. All arrays are in memory at once.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ibdata._numerics.arrays import Arrays
from ibdata._numerics.naming import counted, exact
from ibdata.errors import SPLIT, UsageError
from ibdata.exporters._source import Source, write_npz

HISTORY = 30
MAX_ROWS = 2**24  # float32 does not have all whole numbers above it


def export(source: Source, path: Path, target: Path) -> str:
    """Write the NPZ. Raises UsageError for several setpoints or too many rows."""
    if source.rows > MAX_ROWS:
        raise UsageError(
            f"neorl: found {counted(source.rows, 'row')}, expected at most {MAX_ROWS:,}; use one {SPLIT}"
        )
    if source.info.drifting:
        raise UsageError("neorl: found moving setpoints, expected one that is constant; use another format")
    if len(source.setpoints) > 1:
        shown = ", ".join(exact(p) for p in sorted(source.setpoints)[:5])
        raise UsageError(
            f"neorl: found the setpoints {shown}, expected one setpoint; use one {SPLIT}, see ibdata split"
        )
    write_npz(source, _arrays, path, index=np.cumsum(source.lengths))
    return f"""\
import numpy as np

data = dict(np.load({str(target)!r}))
data["index"] = np.insert(data["index"], 0, 0)[:-1]  # first rows, as NeoRL's loader gives them
"""


def _arrays(block: Arrays) -> Arrays:
    """The arrays of NeoRL, except the index."""
    return {
        "obs": block["observations"],
        "next_obs": block["next_observations"],
        "action": block["actions"],
        "reward": block["rewards"][:, None],
        "done": (block["terminated"] | block["truncated"])[:, None].astype(np.float32),
    }
