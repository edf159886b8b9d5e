"""The values that windows are gathered from, in memory or in files."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.dataset.manifest import refuse_inside
from ibdata.dataset.transitions import Transitions
from ibdata.errors import UsageError
from ibdata.system import files
from ibdata.system.part import locked_part, resolved

Float32s = npt.NDArray[np.float32]
DESCRIPTION = "windows.json"
PATIENCE = 3600.0  # seconds to wait for another process that makes the same folder


class Sizes(NamedTuple):
    """The numbers of episodes, of transitions, and of values in a frame."""

    episodes: int
    rows: int
    frame: int


class Source(NamedTuple):
    """A folder with the values of windows, and what they are."""

    folder: Path
    description: dict[str, Any]
    sizes: Sizes


class Stored(NamedTuple):
    """One copy of the values that windows are gathered from.

    For an episode of T transitions there are T + 1 frames. The frames are stored newest first, so that a
    window is contiguous in memory: frame number i of E episodes with N transitions is row N + E - 1 - i.
    """

    frames: Float32s  # (N + E, k)
    actions: Float32s  # (N, 3)
    rewards: Float32s  # (N,)
    terminated: npt.NDArray[np.bool_]  # (N,)
    truncated: npt.NDArray[np.bool_]  # (N,)
    lengths: npt.NDArray[np.int64]  # (E,)

    def fill(self, blocks: Iterable[Transitions]) -> None:
        """Copy the transitions of whole episodes, in order."""
        row = episode = 0
        for made in blocks:
            starts = np.flatnonzero(made.step == 0)
            for start, length in zip(starts, np.diff(starts, append=len(made.step)), strict=True):
                stop = start + length
                place = len(self.frames) - row - episode - 1
                self.frames[place - length + 1 : place + 1] = made.frames[start:stop][::-1]
                self.frames[place - length] = made.next_frames[stop - 1]
                self.lengths[episode] = length
                for name in ("actions", "rewards", "terminated", "truncated"):
                    getattr(self, name)[row : row + length] = getattr(made, name)[start:stop]
                row, episode = row + length, episode + 1


def in_memory(sizes: Sizes, blocks: Iterable[Transitions]) -> Stored:
    """Store transitions in memory."""
    stored = Stored(*(np.empty(shape, dtype) for shape, dtype in _forms(sizes)))
    stored.fill(blocks)
    return stored


def in_folder(source: Source, blocks: Iterable[Transitions]) -> Stored:
    """Map the values from files in a folder, which are written first if they are not there.

    Raises UsageError if the folder holds anything else.
    """
    if not os.path.exists(source.folder):  # a name may be too long to be looked for
        refuse_inside(source.folder)
        _make(source, blocks)
    return mapped(source)


def mapped(source: Source) -> Stored:
    """Map the values from the files in a folder. Raises UsageError if it is gone or holds anything else."""
    folder, description, sizes = source
    try:
        described = json.loads((folder / DESCRIPTION).read_bytes())
    except (OSError, ValueError):
        described = None
    if not folder.exists():
        raise UsageError(f"folder: {folder} is gone, expected the values of windows; make the windows again")
    if described != json.loads(json.dumps(description)):
        raise UsageError(f"folder: {folder} holds something else than these windows; choose another folder")
    try:
        stored = Stored(*(np.load(folder / f"{name}.npy", mmap_mode="r") for name in Stored._fields))
    except Exception as error:  # whatever numpy and zipfile raise for other bytes
        raise _damaged(folder, error) from None
    if [(array.shape, array.dtype) for array in stored] != _forms(sizes):
        raise _damaged(folder, "found arrays of other sizes")
    return stored


def _damaged(folder: Path, found: object) -> UsageError:
    return UsageError(f"folder: {folder} is damaged ({found}); remove it, or choose another folder")


def _make(source: Source, blocks: Iterable[Transitions]) -> None:
    """Make a folder of windows in its part, unless another process has made it meanwhile."""
    folder, description, sizes = source
    target = resolved(folder)
    with locked_part(target, folder, patience=PATIENCE) as part:
        if part.receipts:
            raise UsageError(f"{folder}: an unfinished run of generate has this name; choose another folder")
        part.clear()  # what a killed process has left
        if not target.exists():
            _write(part.folder / "windows", description, sizes, blocks)
            part.place(part.folder / "windows")


def _write(folder: Path, description: dict[str, Any], sizes: Sizes, blocks: Iterable[Transitions]) -> None:
    """Write the values into a new folder."""
    folder.mkdir()
    forms = dict(zip(Stored._fields, _forms(sizes), strict=True))
    size = sum(math.prod(shape) * np.dtype(dtype).itemsize for shape, dtype in forms.values())
    with (folder / DESCRIPTION).open("w") as file:
        files.reserve(file.fileno(), size)  # a full disk would end the process that fills a map
        file.truncate(0)
        json.dump(description, file, sort_keys=True)
    maps = [
        np.lib.format.open_memmap(folder / f"{name}.npy", "w+", dtype, shape)
        for name, (shape, dtype) in forms.items()
    ]
    Stored(*maps).fill(blocks)
    for each in maps:
        each.flush()


def _forms(sizes: Sizes) -> list[tuple[Any, Any]]:
    """The shape and the type of each array of `Stored`."""
    episodes, rows, frame = sizes
    return [
        ((rows + episodes, frame), np.float32),
        ((rows, 3), np.float32),
        ((rows,), np.float32),
        ((rows,), np.bool_),
        ((rows,), np.bool_),
        ((episodes,), np.int64),
    ]
