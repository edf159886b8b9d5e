"""The data of an export: the rows of a selection, in blocks of whole episodes, in constant memory."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ibdata._numerics.arrays import Array, Arrays
from ibdata._numerics.naming import decimal
from ibdata._system.progress import bar
from ibdata.dataset.dataset import Dataset
from ibdata.dataset.digest import identity
from ibdata.dataset.episodes import BLOCK_ROWS, refuse_empty
from ibdata.dataset.transitions import arrays_of, beside, columns_of, left_out, needed, whole_episodes
from ibdata.errors import UsageError
from ibdata.views.options import PLAIN, ViewOptions

PARQUET = {"compression": "zstd", "use_dictionary": False, "write_page_checksum": True}
# Roles of columns that are exported beside the transitions.
ROLES = ("latent", "next_latent", "log_prob")


class Source:
    """The rows of a selection, with stacked frames and the rewards of a view.

    Raises UsageError for columns that the dataset does not have, and for an empty selection.
    """

    def __init__(
        self,
        selection: Dataset,
        history: int = 1,
        options: ViewOptions = PLAIN,
        progress: bool | None = False,
    ) -> None:
        self.selection = selection
        self.history = history
        self.options = options
        self.progress = progress
        self.info = info = selection.stored.info
        self.frame = options.frame(info.drifting)  # the names of the numbers of a frame
        self.hidden = [column.name for column in info.columns if column.role in ROLES]
        self.beside = beside(info, options)
        # Columns that are measured imperfectly, whose true values are exported too.
        self.clean = [x for x in options.columns(info.drifting) if x in options.imperfections.columns]

        self._needed = needed(info, options)
        refuse_empty(selection)
        self.table = selection.episodes  # one row per episode that is exported
        lengths: Array = self.table["length"].to_numpy() - left_out(info, options)
        self.lengths = lengths[lengths > 0]  # transitions per episode; one without any is not exported
        self.episodes = len(self.lengths)
        self.rows = int(self.lengths.sum())  # transitions
        self.left_out = int(self.table["length"].sum()) - self.rows  # their next frames are not known

    @property
    def setpoints(self) -> list[float]:
        """The setpoints of the episodes, in the order of the first ones."""
        return [decimal(p) for p in self.table["setpoint"].unique()]

    def refuse_no_rows(self) -> None:
        """Raise UsageError if no row has its next frame in the dataset."""
        if not self.rows:
            raise UsageError(
                "view: found no transition whose next frame is in the dataset, "
                "expected episodes of several steps"
            )

    def plain(self) -> dict[str, Any]:
        """What the export shows, as JSON data for its own metadata.

        Of a selection that is no split, `episodes` is a hash of the episodes. So it is with imperfections, as
        these depend on the numbers of the episodes.
        """
        split = self.selection.chosen_split
        shown = {"content_root": self.selection.content_root, "split": split, "history": self.history}
        if self.options.imperfections or (split is None and self.selection.mask is not None):
            shown["episodes"] = identity(self.selection.episode_table)
        return shown | self.options.plain(self.info.drifting)

    def tables(self, columns: list[str]) -> Iterator[pa.Table]:
        """Yield the rows in order, in tables of whole episodes, with these columns and those of the view."""
        names = list(dict.fromkeys([*columns, *self._needed]))
        batches = self.selection.iter_batches(names, batch_rows=max(1, BLOCK_ROWS // self.history))
        with bar(self.progress, self.rows + self.left_out, "rows") as advance:
            for table in whole_episodes(batches, self.selection.place):
                yield table
                advance(table.num_rows)

    def blocks(self) -> Iterator[Arrays]:
        """Yield the transitions in order, as `Dataset.arrays` has them, but in float32.

        What only some formats keep is infos/…: hidden columns, true values, and what stands beside the rows.
        """
        columns = [*self.hidden, *self.clean]
        for table in self.tables(columns):
            arrays = arrays_of(table, self.info, self.options, self.history, False, columns)
            for name, array in arrays.items():
                if array.dtype == np.float64:
                    arrays[name] = array.astype(np.float32)
            infos = {name: arrays[name] for name in self.hidden}
            infos |= {f"clean_{name}": arrays[name] for name in self.clean}
            infos |= columns_of({name: arrays[name] for name in self.beside if name != "costs"})
            moved = {*columns, *self.beside} - {"costs"}
            if len(arrays["step"]):
                block = {name: array for name, array in arrays.items() if name not in moved}
                yield block | {f"infos/{name}": array for name, array in infos.items()}

    def episode_blocks(self) -> Iterator[Arrays]:
        """Yield the transitions in order, those of each episode in a block."""
        for block in self.blocks():
            ends = np.flatnonzero(block["terminated"] | block["truncated"]) + 1
            for start, stop in pairwise([0, *ends.tolist()]):
                yield {name: array[start:stop] for name, array in block.items()}


def vectors(array: Array) -> pa.Array:
    """The rows of a matrix as lists of one size."""
    values = pa.array(np.ascontiguousarray(array).reshape(-1))
    return pa.FixedSizeListArray.from_arrays(values, array.shape[1])


D4RL = {"terminated": "terminals", "truncated": "timeouts", "episode": "infos/episode", "step": "infos/step"}


def d4rl_arrays(block: Arrays) -> Arrays:
    """The arrays under the names of D4RL, and costs under that of DSRL if the view has a cost."""
    return {D4RL.get(name, name): array for name, array in block.items()}


def write_npz(source: Source, make: Callable[[Arrays], Arrays], path: Path, **others: Array) -> None:
    """Write the arrays of all blocks, and others, as an NPZ that is not compressed."""
    arrays: Arrays = {}
    start = 0
    for block in source.blocks():
        stop = start + len(block["rewards"])
        for name, array in make(block).items():
            if name not in arrays:
                arrays[name] = np.empty((source.rows, *array.shape[1:]), array.dtype)
            arrays[name][start:stop] = array
        start = stop
    with path.open("xb") as file, zipfile.ZipFile(file, "w") as archive:  # at once: np.savez takes no comment
        archive.comment = json.dumps(source.plain()).encode()
        for name, array in {**arrays, **others}.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)
