"""Windows: histories of observations, gathered when they are asked for from values in memory or in files."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from ibdata._numerics.arrays import Array, Float32s
from ibdata._system import files
from ibdata._system.part import locked_part, resolved, tidy
from ibdata.dataset.manifest import refuse_inside
from ibdata.dataset.transitions import BESIDE, Transitions
from ibdata.errors import UsageError

DESCRIPTION = "windows.json"
OF_EPISODES = ("frames", "lengths", "episodes")  # arrays that have no value for each row
PATIENCE = 3600.0  # seconds to wait for another process that makes the same folder


class Sizes(NamedTuple):
    """The numbers of episodes, of transitions and of values in a frame, and what stands beside each row."""

    episodes: int
    rows: int
    frame: int
    beside: list[str]

    def shapes(self) -> dict[str, tuple[tuple[int, ...], type]]:
        """The shape and the type of each array of `WindowData`.

        For an episode of T transitions there are T + 1 frames. The frames are stored newest first, so that a
        window is contiguous in memory: frame number i of E episodes with N transitions is row N + E - 1 - i.
        """
        episodes, rows, frame, _ = self
        return {
            "frames": ((rows + episodes, frame), np.float32),
            "lengths": ((episodes,), np.int64),
            "episodes": ((episodes,), np.int64),  # their numbers in the dataset
            "actions": ((rows, 3), np.float32),
            "rewards": ((rows,), np.float32),
            "terminated": ((rows,), np.bool_),
            "truncated": ((rows,), np.bool_),
            **{name: ((rows, *BESIDE[name].width), np.float32) for name in self.beside},
        }


class WindowFolder(NamedTuple):
    """A folder with the values of windows, and what they are."""

    folder: Path
    description: dict[str, Any]
    sizes: Sizes


WindowData = dict[str, Array]  # one copy of the values that windows are gathered from, see `Sizes.shapes`


def _fill(stored: Mapping[str, Array], blocks: Iterable[Transitions]) -> None:
    """Copy the transitions of whole episodes, in order."""
    row = episode = 0
    frames, names = stored["frames"], [name for name in stored if name not in OF_EPISODES]
    for block in blocks:
        columns = {**block._asdict(), **block.beside}
        starts = np.flatnonzero(block.step == 0)
        for start, length in zip(starts, np.diff(starts, append=len(block.step)), strict=True):
            stop = start + length
            place = len(frames) - row - episode - 1
            frames[place - length + 1 : place + 1] = block.frames[start:stop][::-1]
            frames[place - length] = block.next_frames[stop - 1]
            stored["lengths"][episode], stored["episodes"][episode] = length, block.episode[start]
            for name in names:
                stored[name][row : row + length] = columns[name][start:stop]
            row, episode = row + length, episode + 1


def in_memory(sizes: Sizes, blocks: Iterable[Transitions]) -> WindowData:
    """Store transitions in memory."""
    stored: WindowData = {name: np.empty(shape, dtype) for name, (shape, dtype) in sizes.shapes().items()}
    _fill(stored, blocks)
    return stored


def fill_folder(source: WindowFolder, blocks: Iterable[Transitions]) -> None:
    """Write the values into the folder, unless it is there."""
    folder, description, sizes = source
    tidy(folder)
    if not os.path.exists(folder):  # a name may be too long to be looked for
        refuse_inside(folder)
        target = resolved(folder)
        with locked_part(target, folder, patience=PATIENCE) as part:
            if part.receipts:
                raise UsageError(
                    f"{folder}: an unfinished run of generate has this name; choose another folder"
                )
            part.clear()  # what a killed process has left
            if not target.exists():  # another process may have made it meanwhile
                _write(part.folder / "windows", description, sizes, blocks)
                part.place(part.folder / "windows")


def mapped(source: WindowFolder) -> WindowData:
    """Map the values from the files in a folder. Raises UsageError if it is gone or holds anything else."""
    folder, description, sizes = source
    try:
        described = json.loads(files.plain_bytes(folder / DESCRIPTION))
    except (OSError, ValueError):
        described = None
    if not folder.exists():
        raise UsageError(f"folder: {folder} is gone, expected the values of windows; make the windows again")
    if described != json.loads(json.dumps(description)):
        raise UsageError(f"folder: {folder} holds something else than these windows; choose another folder")
    try:
        stored = {name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in sizes.shapes()}
    except Exception as error:  # whatever numpy and zipfile raise for other bytes
        raise _damaged(folder, error) from None
    if {name: (array.shape, array.dtype) for name, array in stored.items()} != sizes.shapes():
        raise _damaged(folder, "found arrays of other sizes")
    return stored


def _damaged(folder: Path, description: object) -> UsageError:
    return UsageError(f"folder: {folder} is damaged ({description}); remove it, or choose another folder")


def _write(folder: Path, description: dict[str, Any], sizes: Sizes, blocks: Iterable[Transitions]) -> None:
    """Write the values into a new folder."""
    folder.mkdir()
    shapes = sizes.shapes()
    size = sum(math.prod(shape) * np.dtype(dtype).itemsize for shape, dtype in shapes.values())
    with (folder / DESCRIPTION).open("w") as file:
        files.reserve(file, size)  # a full disk would end the process that fills a map
        file.truncate(0)
        json.dump(description, file, sort_keys=True)
    maps = {
        name: np.lib.format.open_memmap(folder / f"{name}.npy", "w+", dtype, shape)
        for name, (shape, dtype) in shapes.items()
    }
    _fill(maps, blocks)
    for array in maps.values():
        array.flush()


class Batch(Sequence[dict[str, Any]]):
    """Some transitions. `arrays` has them all; as a sequence, it has one mapping for each."""

    def __init__(self, arrays: dict[str, Array]) -> None:
        self.arrays = arrays

    def __len__(self) -> int:
        return len(self.arrays["rewards"])

    def __getitem__(self, place: Any) -> Any:
        return {name: array[place] for name, array in self.arrays.items()}


class Windows:
    """The transitions of a dataset with histories, which are gathered on access.

    A map-style dataset for `torch.utils.data.DataLoader`, preferably with `collate_fn=windows.collate`:
    `windows[i]` is a mapping with observations and next_observations (k · history,), newest first, actions
    (3,), rewards, terminated, truncated, episode and step. `windows.batch(indices)` has the same for several
    transitions, as has `windows[i:j]`.

    Attributes:
        frame: the names of the numbers of a frame, which are repeated for each step of the history.
        left_out: the number of transitions that are left out, because the dataset does not have their next
            frame.
    """

    def __init__(
        self, source: WindowData | WindowFolder, frame: Sequence[str], history: int, drop: bool, left_out: int
    ) -> None:
        self.frame, self.history, self.left_out = tuple(frame), history, left_out
        self._source, self._drop = source, drop
        self._stored = stored = mapped(source) if isinstance(source, WindowFolder) else source
        self._skipped = history - 1 if drop else 0  # transitions at the beginning of each episode
        lengths, frames = stored["lengths"], stored["frames"]
        self._starts = np.cumsum(lengths) - lengths
        counts = np.maximum(lengths - self._skipped, 0)
        self._stops = np.cumsum(counts)
        self._firsts = self._stops - counts
        flat, k = frames.reshape(-1), frames.shape[1]
        self._windows = None  # if the dataset is shorter than a window
        if len(frames) > history:
            self._windows = sliding_window_view(flat, (history + 1) * k)[::k]

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy for another process: the folder of the values if they are in one, else each value once."""
        return Windows, (self._source, self.frame, self.history, self._drop, self.left_out)

    def __len__(self) -> int:
        return int(self._stops[-1]) if len(self._stops) else 0

    def __repr__(self) -> str:
        frames = f"{self.history} frames of {len(self.frame)} numbers"
        return f"<ibdata.Windows: {len(self):,} transitions, {frames}>"

    def __getitem__(self, index: Any) -> dict[str, Any]:
        chosen = range(len(self))[index]  # which raises IndexError beyond the end
        if isinstance(chosen, range):
            return self.batch(chosen)
        return {name: array[0] for name, array in self.batch([chosen]).items()}

    def __getitems__(self, indices: Sequence[int]) -> Batch:
        return Batch(self.batch(indices))

    def batch(self, indices: npt.ArrayLike) -> dict[str, Array]:
        """The transitions with these numbers (n,), from 0 to len - 1, or those where a mask (len,) is true.

        Returns:
            observations and next_observations (n, k · history), newest first, actions (n, 3), and rewards,
            terminated, truncated, episode, step and, if the view has a cost, costs (n,); expert_actions
            (n, 3) if the dataset has them. They are copies; the two observations share memory.

        Raises:
            IndexError: a number is out of range, or these are neither whole numbers nor a mask.
        """
        numbers = self._numbers(np.asarray(indices))
        episode = np.searchsorted(self._stops, numbers, side="right")
        step = numbers - self._firsts[episode] + self._skipped
        rows = self._starts[episode] + step
        gathered = self._gathered(rows + episode, step)
        k = len(self.frame)
        stored = self._stored
        return {
            "observations": gathered[:, k:],
            **{name: array[rows] for name, array in stored.items() if name not in OF_EPISODES},
            "next_observations": gathered[:, : k * self.history],
            "episode": stored["episodes"][episode],
            "step": step.astype(np.int32),
        }

    def _numbers(self, numbers: Array) -> Array:
        """The numbers of transitions (n,) that are given as numbers, as a mask, or by an empty array."""
        if numbers.dtype == bool and numbers.shape == (len(self),):
            return np.flatnonzero(numbers)
        if numbers.ndim != 1 or (numbers.dtype.kind not in "iu" and (len(numbers) or numbers.dtype == bool)):
            raise IndexError(
                f"found {numbers.dtype} {numbers.shape}, expected whole numbers (n,) or a mask ({len(self)},)"
            )
        if len(numbers) and not 0 <= numbers.min() <= numbers.max() < len(self):
            raise IndexError(f"found {numbers.min()} … {numbers.max()}, expected 0 … {len(self) - 1}")
        return numbers.astype(np.int64)

    def _gathered(self, numbers: Array, steps: Array) -> Float32s:
        """The frame after each of these frames, this frame, and those before it, (n, (history + 1) · k)."""
        frames = self._stored["frames"]
        newest = len(frames) - 2 - numbers  # the place of the frame after
        early = np.flatnonzero(steps < self.history - 1)
        if self._windows is None:
            early = np.arange(len(numbers))
            gathered = np.empty((len(numbers), (self.history + 1) * frames.shape[1]), dtype=np.float32)
        else:
            gathered = self._windows[np.minimum(newest, len(self._windows) - 1)]
        if len(early):  # before the first frame of an episode, that one is repeated
            ages = np.minimum(np.arange(self.history + 1), steps[early, None] + 1)
            gathered[early] = frames[newest[early, None] + ages].reshape(len(early), -1)
        return gathered

    @staticmethod
    def collate(batch: Batch | Sequence[dict[str, Any]]) -> dict[str, Any]:
        """A batch as a mapping of torch tensors, for `DataLoader(windows, collate_fn=windows.collate)`."""
        import torch

        if not isinstance(batch, Batch):  # a DataLoader that fetches one transition at a time
            batch = Batch({name: np.stack([one[name] for one in batch]) for name in batch[0]})
        return {name: torch.from_numpy(array) for name, array in batch.arrays.items()}
