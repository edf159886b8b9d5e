"""The rows of a dataset as a view shows them: as arrays, batches or windows."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata.dataset.models import Info
from ibdata.dataset.transitions import Transitions, as_batch, left_out, stacked, transitions
from ibdata.dataset.windows import Sizes, WindowFolder, Windows, in_folder, in_memory
from ibdata.system.storage import local
from ibdata.views.options import ViewOptions

Array = npt.NDArray[Any]
BLOCK_ROWS = 65_536


def arrays_of(
    table: pa.Table, info: Info, options: ViewOptions, history: int, drop: bool, columns: Sequence[str]
) -> dict[str, Array]:
    """The rows of whole episodes as the arrays that `Dataset.arrays` describes.

    `drop` leaves out the rows with fewer frames before them. The table has the columns too.
    """
    block = transitions(table, info, options)
    observations, after = stacked(block.frames, block.next_frames, block.step, history)
    arrays = {
        "observations": observations,
        "actions": block.actions,
        "rewards": block.rewards,
        **({} if block.costs is None else {"costs": block.costs}),
        "next_observations": after,
        "episode": block.episode,
        "step": block.step,
        "terminated": block.terminated,
        "truncated": block.truncated,
    }
    # Not those that are arrays already: where a view leaves rows out, an episode ends at an earlier one.
    arrays |= {name: table[name].to_numpy()[block.rows] for name in columns if name not in arrays}
    if not drop or history == 1:
        return {name: np.require(array, requirements="W") for name, array in arrays.items()}
    whole = block.step >= history - 1
    return {name: array[whole] for name, array in arrays.items()}


def batches_of(
    blocks: Iterable[Transitions], frame: Sequence[str], batch_rows: int
) -> Iterator[pa.RecordBatch]:
    """Transitions as batches of at most so many rows; `frame` has the names of the numbers of a frame."""
    for block in blocks:
        batch = as_batch(block, frame)
        for start in range(0, batch.num_rows, batch_rows):
            yield batch.slice(start, batch_rows)


def windows_of(
    blocks: Iterable[Transitions],
    episodes: pa.Table,
    info: Info,
    options: ViewOptions,
    content_root: str,
    folder: str | os.PathLike[str] | None,
    history: int,
    drop: bool,
) -> Windows:
    """The windows that `Dataset.windows` describes, of the transitions of these episodes."""
    lengths = episodes["length"].to_numpy()
    kept = np.maximum(lengths - left_out(info, options), 0)
    frame = options.frame(info.drifting)
    rows = int(kept.sum())
    costs = 0 if options.cost is None else rows
    sizes = Sizes(episodes=int(np.count_nonzero(kept)), rows=rows, frame=len(frame), costs=costs)
    count = int((lengths - kept).sum())
    if folder is None or not sizes.rows:  # nothing to keep in files
        return Windows(in_memory(sizes, blocks), frame, history, drop, count)
    description = {
        "content_root": content_root,
        "episodes": identity(episodes),
        "view": options.plain(info.drifting),
    }
    source = WindowFolder(local(folder).absolute(), description, sizes)
    return Windows(in_folder(source, blocks), frame, history, drop, count, source)


def identity(episodes: pa.Table) -> str:
    """A hash of the contents and the numbers of episodes, whose order a content root does not tell."""
    numbers_and_digests = list(
        zip(episodes["episode"].to_pylist(), episodes["digest"].to_pylist(), strict=True)
    )
    return hashlib.sha256(repr(numbers_and_digests).encode()).hexdigest()
