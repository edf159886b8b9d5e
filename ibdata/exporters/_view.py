"""The data of an export: a dataset or a split of it, in blocks of whole episodes, in constant memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata.dataset.history import stacked
from ibdata.dataset.reader import Dataset
from ibdata.dataset.transitions import Transitions, left_out, needed, transitions, whole_episodes
from ibdata.dataset.viewed import BLOCK_ROWS, identity
from ibdata.system.progress import Advance, bar
from ibdata.views.options import PLAIN, ViewOptions

if TYPE_CHECKING:
    import pandas as pd

Array = npt.NDArray[Any]
Arrays = dict[str, Array]

EXTRAS = ("latent", "next_latent", "log_prob")  # roles of columns that are exported beside the transitions


class Block(NamedTuple):
    """The n transitions of one or more whole episodes; floats are float32."""

    observations: Array  # (n, k · history), newest frame first
    actions: Array  # (n, 3)
    rewards: Array  # (n,)
    next_observations: Array  # (n, k · history)
    terminated: Array  # (n,) bool
    truncated: Array  # (n,) bool
    episode: Array  # (n,) int64
    step: Array  # (n,) int32
    extras: Arrays  # (n,) each, by column: latent state, log density of the action, clean values

    def split(self) -> Iterator[Block]:
        """Yield the episodes, one block each."""
        ends = np.flatnonzero(self.terminated | self.truncated) + 1
        for start, stop in zip([0, *ends[:-1]], ends, strict=True):
            arrays = {name: getattr(self, name)[start:stop] for name in self._fields[:-1]}
            extras = {name: array[start:stop] for name, array in self.extras.items()}
            yield Block(**arrays, extras=extras)


@dataclass(frozen=True)
class View:
    """A dataset or a split of it, with stacked frames and the rewards of a view."""

    dataset: Dataset
    split: str | None = None
    history: int = 1
    options: ViewOptions = PLAIN
    progress: bool | None = False

    def __post_init__(self) -> None:
        needed(self.dataset.info_model, self.options)
        self.dataset.iter_batches(["step"], self.split)  # reads nothing yet, but refuses an unknown split

    @property
    def reward_scale(self) -> float:
        """The factor by which rewards are multiplied."""
        return self.options.reward_scale

    @cached_property
    def lengths(self) -> Array:
        """The numbers of transitions of the episodes, in order; an episode without any is not exported."""
        info = self.dataset.info_model
        lengths: Array = self.described()["length"].to_numpy() - left_out(info, self.options)
        return lengths[lengths > 0]

    @property
    def rows(self) -> int:
        """The number of transitions."""
        return int(self.lengths.sum())

    @property
    def episodes(self) -> int:
        """The number of episodes."""
        return len(self.lengths)

    @property
    def left_out(self) -> int:
        """The number of transitions that are left out, because their next frames are not in the dataset."""
        return int(self.described()["length"].sum()) - self.rows

    @property
    def frame(self) -> tuple[str, ...]:
        """The names of the numbers of a frame."""
        return self.options.frame(self.dataset.info_model.drifting)

    @property
    def bytes(self) -> int:
        """The size of the arrays of all blocks, uncompressed."""
        floats = 2 * len(self.frame) * self.history + len(self.group("action")) + 1
        floats += sum(len(self.group(role)) for role in EXTRAS) + len(self.clean)
        return self.rows * (4 * floats + 8 + 4 + 1 + 1)

    @property
    def history_bytes(self) -> int:
        """The size of the histories of the longest episode, which are in memory at once."""
        longest = int(self.dataset.episodes["length"].max())
        return 2 * 4 * len(self.frame) * self.history * longest

    @property
    def clean(self) -> tuple[str, ...]:
        """The columns that the view measures imperfectly, whose true values are exported beside."""
        observed = self.options.columns(self.dataset.info_model.drifting)
        return tuple(name for name in observed if name in self.options.imperfections.columns)

    def group(self, role: str) -> list[str]:
        """The names of the columns of a role."""
        return self.dataset.info_model.names(role)

    def plain(self) -> dict[str, Any]:
        """What the export shows, as JSON data for its own metadata.

        Imperfections depend on the numbers of the episodes, so with them `episodes` is a hash of their order.
        """
        order = (
            {"episodes": identity(self.dataset.episode_table.filter(self._exported))}
            if self.options.imperfections
            else {}
        )
        return {
            "content_root": self.dataset.content_root,
            "split": self.split,
            "history": self.history,
            **order,
            **self.options.plain(self.dataset.info_model.drifting),
        }

    @property
    def _exported(self) -> Array:
        return self.dataset.selected(self.split)

    def described(self) -> pd.DataFrame:
        """The rows of `Dataset.episodes` that are exported."""
        return self.dataset.episodes[self._exported]

    def tables(self, columns: list[str], what: str) -> Iterator[pa.Table]:
        """Yield the rows in order, in tables of whole episodes; `what` is the label of the progress bar."""
        rows = max(1, BLOCK_ROWS // self.history)
        names = list(dict.fromkeys([*columns, *needed(self.dataset.info_model, self.options)]))
        with bar(self.progress, self._all_rows, "rows", what) as advance:
            batches = self.dataset.iter_batches(names, self.split, rows)
            yield from whole_episodes(_counted(batches, advance), self.dataset.place)

    def blocks(self, what: str) -> Iterator[Block]:
        """Yield the transitions in order; `what` is the label of the progress bar."""
        columns = [name for role in EXTRAS for name in self.group(role)]
        for table in self.tables(columns, what):
            made = transitions(table, self.dataset.info_model, self.options)
            if len(made.rewards):
                yield self._block(table, made, columns)

    def _block(self, table: pa.Table, made: Transitions, columns: list[str]) -> Block:
        def float32(array: Array) -> Array:
            return array.astype(np.float32, copy=False)

        def beside(name: str) -> Array:
            return float32(table[name].to_numpy())[made.rows]

        now, after = stacked(float32(made.frames), float32(made.next_frames), made.step, self.history)
        return Block(
            now,
            float32(made.actions),
            float32(made.rewards),
            after,
            made.terminated,
            made.truncated,
            made.episode,
            made.step,
            {
                **{name: beside(name) for name in columns},
                **{f"clean_{name}": beside(name) for name in self.clean},
            },
        )

    @property
    def _all_rows(self) -> int:
        """The number of rows that are read."""
        return self.rows + self.left_out


def _counted(batches: Iterator[pa.RecordBatch], advance: Advance) -> Iterator[pa.RecordBatch]:
    for batch in batches:
        advance(batch.num_rows)
        yield batch
