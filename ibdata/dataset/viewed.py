"""The rows of a dataset as a view shows them: as arrays, batches or windows."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Sequence
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata.dataset.history import stacked
from ibdata.dataset.models import Info
from ibdata.dataset.selection import Policy, Setpoint, selected
from ibdata.dataset.stored_windows import in_folder, in_memory
from ibdata.dataset.transitions import (
    Transitions,
    as_batch,
    left_out,
    needed,
    transitions,
    whole_episodes,
)
from ibdata.dataset.windows import Windows
from ibdata.errors import UsageError
from ibdata.system.object_store import refuse_url
from ibdata.views.options import ViewOptions

if TYPE_CHECKING:
    from ibdata.dataset.reader import Dataset

Array = npt.NDArray[Any]
BLOCK_ROWS = 65_536


def checked_length(length: Any, name: str = "history") -> int:
    """The number of observations in a history, or of steps. Raises UsageError if it is invalid."""
    if isinstance(length, bool) or not isinstance(length, Integral) or length < 1:
        raise UsageError(f"{name}: found {length!r}, expected a whole number of at least 1")
    return int(length)


def checked_history(history: Any, pad: Any) -> bool:
    """Check both arguments of `Dataset.arrays`; return whether rows without a full history are dropped.

    Raises UsageError if one is invalid.
    """
    checked_length(history)
    if pad not in ("repeat", "drop"):
        raise UsageError(f"pad: found {pad!r}, expected repeat or drop")
    return bool(pad == "drop")


def arrays_of(
    table: pa.Table, info: Info, options: ViewOptions, history: int, drop: bool, columns: Sequence[str]
) -> dict[str, Array]:
    """The rows of whole episodes as the arrays that `Dataset.arrays` describes.

    `drop` leaves out the rows with fewer frames before them. The table has the columns too.
    """
    made = transitions(table, info, options)
    observations, after = stacked(made.frames, made.next_frames, made.step, history)
    arrays = {
        "observations": observations,
        "actions": made.actions,
        "rewards": made.rewards,
        "next_observations": after,
        "episode": made.episode,
        "step": made.step,
        "terminated": made.terminated,
        "truncated": made.truncated,
        **{name: table[name].to_numpy()[made.rows] for name in columns},
    }
    if not drop or history == 1:
        return arrays
    whole = made.step >= history - 1
    return {name: array[whole] for name, array in arrays.items()}


def transitions_of(
    dataset: Dataset,
    options: ViewOptions,
    split: str | None = None,
    setpoint: Setpoint = None,
    policy: Policy = None,
    rows: int = BLOCK_ROWS,
) -> Iterator[Transitions]:
    """Yield the transitions of a dataset in order, those of whole episodes with about `rows` rows at a time.

    Raises UsageError at once if a selection or the view does not fit the dataset.
    """
    info = dataset.info_model
    names = needed(info, options)
    batches = dataset.iter_batches(names, split, rows, setpoint=setpoint, policy=policy)
    return (transitions(table, info, options) for table in whole_episodes(batches, dataset.place))


def batches_of(
    dataset: Dataset, options: ViewOptions, split: str | None, setpoint: Setpoint, policy: Policy, rows: int
) -> Iterator[pa.RecordBatch]:
    """The transitions of a dataset as batches of columns with at most `rows` rows."""
    names = options.frame(dataset.info_model.drifting)
    made = transitions_of(dataset, options, split, setpoint, policy, rows)
    batches = (as_batch(each, names) for each in made)
    return (batch.slice(at, rows) for batch in batches for at in range(0, batch.num_rows, rows))


def windows_of(
    dataset: Dataset,
    options: ViewOptions,
    history: int,
    drop: bool,
    folder: str | os.PathLike[str] | None,
    split: str | None,
    setpoint: Setpoint,
    policy: Policy,
) -> Windows:
    """The windows that `Dataset.windows` describes."""
    info = dataset.info_model
    blocks = transitions_of(dataset, options, split, setpoint, policy)
    chosen = selected(dataset.episode_table, split, setpoint, policy)
    lengths = dataset.episode_table["length"].to_numpy()[chosen]
    kept = np.maximum(lengths - left_out(info, options), 0)
    frame = options.frame(info.drifting)
    sizes = (int(np.count_nonzero(kept)), int(kept.sum()), len(frame))
    if folder is None:
        stored = in_memory(sizes, blocks)
    else:
        description = {
            "content_root": dataset.content_root,
            "episodes": identity(dataset, chosen),
            "view": options.plain(info.drifting),
        }
        refuse_url(folder)
        stored = in_folder(Path(folder), description, sizes, blocks)
    return Windows(stored, frame, history, drop, int((lengths - kept).sum()))


def identity(dataset: Dataset, chosen: npt.NDArray[np.bool_]) -> str:
    """A hash of the contents and the numbers of episodes, whose order a content root does not tell.

    Args:
        dataset: The dataset.
        chosen: Which of its episodes count, (n,).
    """
    table = dataset.episode_table.select(["episode", "digest"]).filter(pa.array(chosen))
    listed = zip(*(table[name].to_pylist() for name in table.column_names), strict=True)
    return hashlib.sha256(repr(list(listed)).encode()).hexdigest()
