"""A file for d3rlpy's ReplayBuffer.load. d3rlpy takes the next observation from the next row, and would lose
the last transition of an episode that ends at a time limit. So each of these episodes gets one more row, with
the final observation, reward 0 and action 0.5. Neither this reward nor this action is used in a transition,
except as the next action of the last one. The value 0.5 keeps d3rlpy from taking actions that are all -1, 0
or 1 for discrete ones. Written in constant memory, but d3rlpy loads the whole file. Needs ibdata[hdf5].
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ibdata._numerics.arrays import Arrays
from ibdata.exporters._source import Source
from ibdata.exporters._target import hdf5_file, library

VERSION = "2.1"  # of d3rlpy's file format
PADDING = 0.5  # of the appended row's action
KEYS = ("observations", "actions", "rewards", "terminated")


def episode(block: Arrays) -> Arrays:
    """An episode in d3rlpy's form, with one more row if it does not terminate.

    observations (n, k · history), actions (n, 3), rewards (n, 1), terminated ().
    """
    padding = 0 if block["terminated"][-1] else 1
    return {
        "observations": np.concatenate([block["observations"], block["next_observations"][-1:][:padding]]),
        "actions": np.pad(block["actions"], ((0, padding), (0, 0)), constant_values=PADDING),
        "rewards": np.pad(block["rewards"], (0, padding))[:, None],
        "terminated": block["terminated"][-1:].reshape(()),
    }


def export(source: Source, path: Path, target: Path) -> str:
    """Write the file."""
    library("h5py", "d3rlpy", "hdf5")
    with hdf5_file(path) as (file, check):
        file.create_dataset("columns", data=list(KEYS))
        file.create_dataset("num_episodes", data=source.episodes)
        file.create_dataset("version", data=VERSION)
        file.attrs["view"] = json.dumps(source.plain())
        for number, block in enumerate(source.episode_blocks()):
            for key, array in episode(block).items():
                file.create_dataset(f"{key}_{number}", data=array)
            check()
    return f"""\
from d3rlpy.dataset import InfiniteBuffer, ReplayBuffer

with open({str(target)!r}, "rb") as file:
    dataset = ReplayBuffer.load(file, InfiniteBuffer())
"""
