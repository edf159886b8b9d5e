"""A place at which a dataset comes to be: a folder, or a store of objects at a URL."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any, Protocol

from ibdata._system.runs import Run
from ibdata._system.storage import Storage, url_of
from ibdata.dataset.models import Manifest
from ibdata.errors import OVERWRITE, DatasetError
from ibdata.generation.folder import Documents, Folder
from ibdata.generation.record import Record
from ibdata.generation.shard import WrittenShard
from ibdata.generation.store import Store


class BuildPlace(Protocol):
    """What `Folder` and `Store` promise: a place, and the part beside it, in which the dataset is made.

    Attributes:
        name: The place in messages.
        files: The files of the place.
        replaces: Whether what is here can be replaced.
    """

    name: str
    replaces: bool

    @property
    def files(self) -> Storage: ...

    def refuse(self, overwrite: bool) -> None:
        """Raise UsageError if no dataset can appear here, or if what is here cannot be replaced."""

    def found(self) -> Storage | None:
        """The files that are here; None if there are none, but for what a publication left half-done."""

    def size_of(self, path: str) -> int | None:
        """The bytes of a file that was found; None if it was not."""

    def refuse_replacing(self, listed: Manifest) -> None:
        """Raise UsageError if more than a dataset is here, or if it may not be replaced."""

    def tidy(self) -> None:
        """Remove what a process that was killed has left, unless somebody is at work here."""

    def hold(self, shared: bool) -> AbstractContextManager[None]:
        """Keep others away as far as that is possible; `shared`: but not from other shards of the same."""

    def new_run(self, record: Record) -> Run:
        """The run that a record begins."""

    def begin(self, run: Run, record: Record) -> bool:
        """Note the record in the run, which others may go on with from now on; False if it was begun."""

    def gather(self, run: Run, record: Record, written: list[WrittenShard], documents: Documents) -> None:
        """Bring together all files of the dataset; nobody takes them for one yet."""

    def appear(self, run: Run, record: Record, replace: bool) -> None:
        """Let the dataset appear here, after `gather`."""

    def clear(self, run: Run) -> None:
        """Remove a run from the part."""

    def shown(self, files: Run | Storage) -> str:
        """Where a run, or what was found, is to be removed by a user."""


def place_at(place: Any) -> BuildPlace:
    """The place that a path or a URL names."""
    url = url_of(place)
    return Folder(place) if url is None else Store(url)


def refuse_damage(listed: Manifest, place: BuildPlace) -> None:
    """Raise DatasetError for the first file that a manifest lists and that is missing or has another size."""
    remedy = f"ibdata repair makes the file again, {OVERWRITE} the dataset"
    if not place.replaces:
        remedy = f"remove {place.name} to make it again"
    for path, entry in listed.entries().items():
        if place.size_of(path) != entry.bytes:
            where = f"{place.name}/{path}"
            raise DatasetError(f"{where}: missing or not whole, but the dataset is finished; {remedy}")
