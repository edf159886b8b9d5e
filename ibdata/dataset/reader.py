"""A finished dataset, which is read without running any code of it."""

from __future__ import annotations

import os
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ibdata.arguments import public
from ibdata.dataset import manifest
from ibdata.dataset.readable import Readable
from ibdata.dataset.selection import Selection
from ibdata.dataset.splits import Splits
from ibdata.dataset.stored import Stored
from ibdata.dataset.tabular import Table, as_html
from ibdata.errors import printable
from ibdata.numerics.naming import counted, decimal
from ibdata.system.storage import existing

if TYPE_CHECKING:
    from pathlib import Path


class Dataset(Readable):
    """A finished dataset in a folder or at a URL. Only files that its manifest lists are read.

    If the dataset is replaced after it was opened, reading raises BusyError. Functions that take a folder
    take a Dataset too.

    Args:
        path: The folder, or a URL such as s3://bucket/name. A plain name, without `..`, of which there is no
            folder is looked for in data/, so that the name of a shipped experiment finds its dataset.

    Attributes:
        path: The folder, from the root; UsageError at a URL.
        place: The folder as it was given, or the URL without credentials, as a text.

    Raises:
        DatasetError: There is no finished dataset, or its manifest is damaged.
    """

    @public
    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.stored = Stored.open(existing(path))
        self.storage = self.stored.storage  # by which it is a place

    def __repr__(self) -> str:
        n = self.stored.info.counts
        size = f"{counted(n.rows, 'row')}, {counted(n.episodes, 'episode')}"
        return f"<ibdata.Dataset {printable(self.place)}: {size}>"

    def _repr_html_(self) -> str:
        info, episodes = self.stored.info, self.stored.episodes
        row = {
            "dataset": info.name,
            "rows": info.counts.rows,
            "episodes": info.counts.episodes,
            "policies": episodes["policy"].unique().to_pylist(),
            "setpoints": [decimal(p) for p in episodes["setpoint"].unique().to_numpy()],
            "content root": f"{self.content_root[:12]}…",
            "in": self.place,
        }
        return as_html([Table(list(row), [list(row.values())]), *self.splits.tables()])

    def __fspath__(self) -> str:
        return str(self.path)

    def __len__(self) -> int:
        return self.stored.manifest.rows

    @property
    def _everything(self) -> Selection:
        return Selection(self.stored)

    @property
    def path(self) -> Path:
        """The folder. Raises UsageError for a dataset at a URL."""
        return self.storage.path

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """meta/manifest.json: experiments, shards, files with their SHA-256, content root, versions."""
        return self.stored.manifest.plain()

    @property
    def splits(self) -> Splits:
        """For each split its numbers of episodes and rows, and whether it is declared: of whole files."""
        keys = {"episodes", "rows", "declared"}
        return Splits({name: entry.model_dump(include=keys) for name, entry in self.stored.splits.items()})


Place = Dataset | str | os.PathLike[str]
Rows = Dataset | Selection | str | os.PathLike[str]  # of which rows can be read


def opened(place: Place) -> Dataset:
    """Return a dataset as it is, or open the one in a folder or at a URL."""
    return place if isinstance(place, Dataset) else Dataset(place)


def to_write(place: Place) -> Dataset:
    """Like `opened`, but a writer's folder is not looked for in data/."""
    if not isinstance(place, Dataset):
        manifest.read(place)
    return opened(place)


def readable(rows: Rows) -> Readable:
    """Return a dataset or a selection as it is, or open the dataset in a folder or at a URL."""
    return rows if isinstance(rows, Readable) else Dataset(rows)
