"""The data of an export: a dataset or a split of it, in blocks of whole episodes, in constant memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata.dataset.history import stacked
from ibdata.dataset.models import Counts, SplitCounts
from ibdata.dataset.reader import Dataset
from ibdata.errors import DatasetError, UsageError
from ibdata.system.progress import bar

if TYPE_CHECKING:
    import pandas as pd

Array = npt.NDArray[Any]
Arrays = dict[str, Array]

INDICES = ("episode", "step", "terminated", "truncated")
EXTRAS = ("latent", "next_latent", "log_prob")  # roles of columns that are exported beside the transitions
BLOCK_ROWS = 65_536


class Block(NamedTuple):
    """The n transitions of one or more whole episodes; floats are float32."""

    observations: Array  # (n, 6 · history), newest frame first
    actions: Array  # (n, 3)
    rewards: Array  # (n,)
    next_observations: Array  # (n, 6 · history)
    terminated: Array  # (n,) bool
    truncated: Array  # (n,) bool
    episode: Array  # (n,) int64
    step: Array  # (n,) int32
    extras: Arrays  # (n,) each: latent and next latent state, log density of the action, by column

    def split(self) -> Iterator[Block]:
        """Yield the episodes, one block each."""
        ends = np.flatnonzero(self.terminated | self.truncated) + 1
        for start, stop in zip([0, *ends[:-1]], ends, strict=True):
            arrays = {name: getattr(self, name)[start:stop] for name in self._fields[:-1]}
            extras = {name: array[start:stop] for name, array in self.extras.items()}
            yield Block(**arrays, extras=extras)


@dataclass(frozen=True)
class View:
    """A dataset or a split of it, with stacked observations and scaled rewards."""

    dataset: Dataset
    split: str | None = None
    history: int = 1
    reward_scale: float = 1.0
    progress: bool | None = False

    def __post_init__(self) -> None:
        self.dataset.iter_batches(["step"], self.split)  # reads nothing yet, but refuses an unknown split

    @property
    def rows(self) -> int:
        """The number of transitions."""
        return int(self._counts.rows)

    @property
    def episodes(self) -> int:
        """The number of episodes."""
        return int(self._counts.episodes)

    @property
    def bytes(self) -> int:
        """The size of the arrays of all blocks, uncompressed."""
        floats = 2 * len(self.group("observation")) * self.history + len(self.group("action")) + 1
        floats += sum(len(self.group(role)) for role in EXTRAS)
        return self.rows * (4 * floats + 8 + 4 + 1 + 1)

    @property
    def history_bytes(self) -> int:
        """The size of the histories of the longest episode, which are in memory at once."""
        longest = int(self.dataset.episodes["length"].max())
        return 2 * 4 * len(self.group("observation")) * self.history * longest

    @property
    def _counts(self) -> Counts | SplitCounts:
        info = self.dataset.info_model
        return info.counts if self.split is None else info.splits[self.split]

    def group(self, role: str) -> list[str]:
        """The names of the columns of a role."""
        return self.dataset.info_model.groups.get(role, [])

    def described(self) -> pd.DataFrame:
        """The rows of `Dataset.episodes` that are exported."""
        episodes = self.dataset.episodes
        if self.split is None:
            return episodes
        batches = self.dataset.iter_batches(["episode"], self.split)
        numbers = {number for batch in batches for number in np.unique(_numpy(batch["episode"])).tolist()}
        return episodes[episodes["episode"].isin(numbers)]

    def tables(self, columns: list[str], what: str) -> Iterator[pa.Table]:
        """Yield the rows in order, in tables of whole episodes; `what` is the label of the progress bar.

        The columns must include `terminated`, `truncated` and `reward`. Rewards are scaled.
        """
        rows = max(1, BLOCK_ROWS // self.history)
        rest: list[pa.RecordBatch] = []
        with bar(self.progress, self.rows, "rows", what) as advance:
            for batch in self.dataset.iter_batches(columns, self.split, rows):
                advance(batch.num_rows)
                last = np.flatnonzero(_numpy(batch["truncated"]) | _numpy(batch["terminated"]))
                if not len(last):
                    rest.append(batch)
                    continue
                stop = int(last[-1]) + 1
                yield self._scaled(pa.Table.from_batches([*rest, batch.slice(0, stop)]))
                rest = [batch.slice(stop)] if stop < batch.num_rows else []
        if rest:
            raise DatasetError(f"{self.dataset.path}: the last episode has no end, see ibdata validate")

    def blocks(self, what: str) -> Iterator[Block]:
        """Yield the transitions in order; `what` is the label of the progress bar."""
        roles = ("observation", "action", "next_observation", *EXTRAS)
        columns = [*INDICES, "reward", *(name for role in roles for name in self.group(role))]
        for table in self.tables(columns, what):
            yield self._block(table)

    def _block(self, table: pa.Table) -> Block:
        def float32(names: list[str]) -> Array:
            return np.stack([_numpy(table[name]) for name in names], axis=1).astype(np.float32, copy=False)

        index = {name: _numpy(table[name]) for name in INDICES}
        now, after = stacked(
            float32(self.group("observation")),
            float32(self.group("next_observation")),
            index["step"],
            self.history,
        )
        return Block(
            now,
            float32(self.group("action")),
            float32(["reward"])[:, 0],
            after,
            index["terminated"],
            index["truncated"],
            index["episode"],
            index["step"],
            {name: float32([name])[:, 0] for role in EXTRAS for name in self.group(role)},
        )

    def _scaled(self, table: pa.Table) -> pa.Table:
        if self.reward_scale == 1:
            return table
        place = table.column_names.index("reward")
        rewards = _numpy(table["reward"])
        scaled = rewards.astype(np.float64) * self.reward_scale
        if np.abs(scaled).max() > np.finfo(np.float32).max:
            raise UsageError(f"reward scale: found {self.reward_scale}, which makes rewards infinite")
        return table.set_column(place, table.schema.field(place), pa.array(scaled.astype(rewards.dtype)))


def _numpy(column: Any) -> Array:
    array: Array = column.to_numpy() if isinstance(column, pa.ChunkedArray) else column.to_numpy(False)
    return array
