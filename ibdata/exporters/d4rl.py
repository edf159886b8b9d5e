"""HDF5 with the keys of D4RL: observations, actions, rewards, next_observations, terminals, timeouts, and
infos/… with one entry per row. Metadata are attributes, because D4RL's sequence_dataset expects rows in every
HDF5 dataset. Read the keys yourself: D4RL's qlearning_dataset ignores next_observations and drops the last
row of each episode. Written in constant memory. Needs ibdata[hdf5].
"""

from __future__ import annotations

import json
from pathlib import Path

from ibdata.exporters._source import Source, d4rl_arrays
from ibdata.exporters._target import hdf5_file, library
from ibdata.version import __version__

HOLDS_COSTS = True  # it has a place for them
CHUNK_ROWS = 4096


def export(source: Source, path: Path, target: Path) -> str:
    """Write the HDF5 file."""
    library("h5py", "d4rl", "hdf5")
    with hdf5_file(path) as (file, check):
        file.attrs["ibdata_version"] = __version__
        file.attrs["name"] = source.info.name
        file.attrs["content_root"] = source.selection.content_root
        file.attrs["reward_scale"] = source.options.reward_scale
        file.attrs["view"] = json.dumps(source.plain())
        file.attrs["history"] = source.history
        start = 0
        for block in source.blocks():
            stop = start + len(block["rewards"])
            for name, array in d4rl_arrays(block).items():
                if start == 0:
                    chunks = (min(CHUNK_ROWS, source.rows), *array.shape[1:])
                    shape = (source.rows, *array.shape[1:])
                    file.create_dataset(name, shape, array.dtype, chunks=chunks)
                file[name][start:stop] = array
            check()
            start = stop
    return f"""\
import h5py

with h5py.File({str(target)!r}) as file:
    keys = ("observations", "actions", "rewards", "next_observations", "terminals", "timeouts")
    data = {{key: file[key][:] for key in keys}}
"""
