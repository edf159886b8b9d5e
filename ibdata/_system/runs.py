"""The files of a run: its note, receipts and shards, in a folder or in an object store.

What is written is there as a whole, or not. A shard has a name that says what is in it, so whoever makes it
again writes the same file. A run goes to workers, also on other hosts.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, TypeVar

from ibdata._system.files import (
    FileEntry,
    HashingFile,
    file_sha256,
    new_file,
    read_hashed,
    rename,
    with_hash,
    without_hash,
    write_new,
)
from ibdata._system.part import DATASET, NOTE, RECEIPTS, Part, existing_paths, resolved
from ibdata._system.storage import Remote, Storage
from ibdata.errors import IbdataError

T = TypeVar("T")
DIGITS = 16  # of a shard's SHA-256, in the name of its file


class FolderRun:
    """The files of a run in a folder. Methods raise OSError.

    Attributes:
        name: The place of the run in messages.
        files: All its files.
        lost: The errors of a file that is as good as not there. Another, such as of a network, says nothing.
    """

    lost: tuple[type[OSError], ...] = (OSError,)

    def __init__(self, path: Path) -> None:
        self.path, self.name, self.files = path, str(path), Storage(path)

    def read(self, path: str) -> bytes:
        """The data of a file with a hash. Raises ValueError if they are not what was written."""
        return read_hashed(self.path / path)

    def write(self, path: str, data: bytes) -> None:
        """Write a file with its hash, perhaps in place of another."""
        # beside the folders that are listed; hosts may have equal process ids
        temporary = self.path / f".tmp-{secrets.token_hex(6)}"
        write_new(self.path, temporary.name, with_hash(data))
        (self.path / path).parent.mkdir(exist_ok=True)
        rename(temporary, self.path / path)

    def receipts(self) -> list[str]:
        """The names of the receipts."""
        return [path.name for path in existing_paths(self.path / RECEIPTS)]

    def add(self, stem: str, write: Callable[[HashingFile], T]) -> tuple[FileEntry, T]:
        """Let a function write a shard; its entry, and what the function returns."""
        if not self.path.is_dir():
            raise IbdataError(f"{self.path.parents[1]}: not found, expected a folder that all hosts share")
        temporary = self.path / f".tmp-{secrets.token_hex(6)}"
        with new_file(temporary) as file:
            written = write(file)
        entry = _entry(stem, file)
        (self.path / DATASET / entry.path).parent.mkdir(exist_ok=True)
        rename(temporary, self.path / DATASET / entry.path)
        return entry, written

    def has(self, entry: FileEntry, closely: bool = False) -> bool:
        """Whether a shard is there with this size; `closely`: in a folder, with this hash."""
        path = self.path / DATASET / entry.path
        if closely:
            return file_sha256(path) == entry.sha256
        return path.is_file() and path.stat().st_size == entry.bytes

    def dataset(self) -> Storage | None:
        """The files of the dataset; None if they are gone."""
        return Storage(self.path / DATASET) if (self.path / DATASET).exists() else None


class StoreRun:
    """The files of a run in an object store."""

    lost: tuple[type[OSError], ...] = (FileNotFoundError,)

    def __init__(self, files: Remote) -> None:
        self.files, self.name = files, files.name

    def read(self, path: str) -> bytes:
        return without_hash(self.files.read(path))

    def write(self, path: str, data: bytes) -> None:
        self.files.put_bytes(with_hash(data), path)

    def receipts(self) -> list[str]:
        return self.files.names(RECEIPTS)

    def add(self, stem: str, write: Callable[[HashingFile], T]) -> tuple[FileEntry, T]:
        with TemporaryFile(prefix="ibdata-") as raw:  # which has no name that a killed process could leave
            file = HashingFile(raw)
            written = write(file)
            entry = _entry(stem, file)
            if not self.has(entry):  # else another host has made the same
                raw.seek(0)
                self.files.put(raw, f"{DATASET}/{entry.path}", entry.bytes)
        return entry, written

    def has(self, entry: FileEntry, closely: bool = False) -> bool:
        return self.files.size(f"{DATASET}/{entry.path}") == entry.bytes

    def dataset(self) -> Storage | None:
        return self.files.below(DATASET)

    def remove(self) -> None:
        """Remove the run, its note last, by which whoever comes next sees what else is left."""
        for folder in (DATASET, RECEIPTS):
            if self.files.names(folder):
                self.files.below(folder).remove()
        self.files.remove()


Run = FolderRun | StoreRun


def _entry(stem: str, file: HashingFile) -> FileEntry:
    return FileEntry(f"{stem}-{file.sha256()[:DIGITS]}.parquet", file.size, file.sha256())


def note_of(run: Run) -> dict[str, Any]:
    """The data in the note of a run; none if there is no note that is as it was written."""
    with suppress(*run.lost, ValueError, RecursionError):
        note = json.loads(run.read(NOTE))
        return note if isinstance(note, dict) else {}
    return {}


def runs_at(files: Storage) -> list[Run]:
    """The runs in the part beside a place: at most one at a folder, perhaps several in a store."""
    if not isinstance(files, Remote):
        part = Part(resolved(files.path))
        return [FolderRun(part.run)] if part.run.exists() else []
    names = files.part.names("") if len(files.parts) > 1 else []  # nothing is beside a whole bucket
    runs = [StoreRun(files.part.below(name.rstrip("/"))) for name in names if name.endswith("/")]
    return [run for run in runs if run.files.size(NOTE) is not None]  # else it was removed in part
