"""HDF5 with the keys of D4RL: observations, actions, rewards, next_observations, terminals, timeouts, and
infos/… with one entry per row. Metadata are attributes, because D4RL's sequence_dataset expects rows in every
HDF5 dataset. Read the keys yourself: D4RL's qlearning_dataset ignores next_observations and drops the last
row of each episode. Written in constant memory. Needs ibdata[hdf5].
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ibdata.exporters._arrays import transitions
from ibdata.exporters._hdf5 import Sums, add, read_back, reserve
from ibdata.exporters._target import needed
from ibdata.exporters._view import View
from ibdata.version import __version__

COSTS = True  # it has a place for them
CHUNK_ROWS = 4096
OVERHEAD = 2**20  # bytes per file; 0.37 MB was measured


def export(view: View, path: Path, target: Path) -> str:
    """Write the HDF5 file."""
    h5py = needed("h5py", "d4rl", "hdf5")
    reserve(path, view.bytes + OVERHEAD)
    with read_back(path) as sums, h5py.File(path, "x") as file:
        file.attrs["ibdata_version"] = __version__
        file.attrs["name"] = view.info.name
        file.attrs["content_root"] = view.selection.content_root
        file.attrs["reward_scale"] = view.options.reward_scale
        file.attrs["view"] = json.dumps(view.plain())
        file.attrs["history"] = view.history
        _write(view, file, sums)
    return f"""\
import h5py

with h5py.File({str(target)!r}) as file:
    keys = ("observations", "actions", "rewards", "next_observations", "terminals", "timeouts")
    data = {{key: file[key][:] for key in keys}}
"""


def _write(view: View, file: Any, sums: Sums) -> None:
    start = 0
    for block in view.blocks():
        stop = start + len(block.rewards)
        for name, array in transitions(block).items():
            if start == 0:
                chunks = (min(CHUNK_ROWS, view.rows), *array.shape[1:])
                shape = (view.rows, *array.shape[1:])
                file.create_dataset(name, shape, array.dtype, chunks=chunks)
            file[name][start:stop] = array
            add(sums, name, array)
        start = stop
