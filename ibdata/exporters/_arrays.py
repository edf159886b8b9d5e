"""Exports that are arrays with one entry per transition."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa

from ibdata.exporters._view import Array, Arrays, Block, View

PARQUET = {"compression": "zstd", "use_dictionary": False, "write_page_checksum": True}


def vectors(array: Array) -> pa.Array:
    """The rows of a matrix as lists of one size."""
    values = pa.array(np.ascontiguousarray(array).reshape(-1))
    return pa.FixedSizeListArray.from_arrays(values, array.shape[1])


def transitions(block: Block) -> Arrays:
    """The arrays of D4RL, with the latent state in infos/, and costs as in DSRL if the view has a cost."""
    costs = {"costs": block.extras["cost"]} if "cost" in block.extras else {}
    return {
        "observations": block.observations,
        "actions": block.actions,
        "rewards": block.rewards,
        **costs,
        "next_observations": block.next_observations,
        "terminals": block.terminated,
        "timeouts": block.truncated,
        "infos/episode": block.episode,
        "infos/step": block.step,
        **{f"infos/{name}": array for name, array in block.extras.items() if name != "cost"},
    }


def write_npz(view: View, form: Callable[[Block], Arrays], path: Path, **others: Array) -> None:
    """Write the arrays of all blocks, and others, as an NPZ that is not compressed."""
    arrays: Arrays = {}
    start = 0
    for block in view.blocks():
        stop = start + len(block.rewards)
        for name, array in form(block).items():
            if name not in arrays:
                arrays[name] = np.empty((view.rows, *array.shape[1:]), array.dtype)
            arrays[name][start:stop] = array
        start = stop
    with path.open("xb") as file, zipfile.ZipFile(file, "w") as archive:  # at once: np.savez takes no comment
        archive.comment = json.dumps(view.plain()).encode()
        for name, array in {**arrays, **others}.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)
