"""Files of an export: written in a hidden part beside the target, which gets its name when it is complete."""

from __future__ import annotations

import gzip
import io
import json
import os
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from ibdata._system import files, signals
from ibdata._system.part import locked_part, resolved, tidy
from ibdata.dataset import manifest
from ibdata.errors import OUT, OVERWRITE, SPLIT, IbdataError, UsageError, missing

HEAD = 8  # bytes
CSV = b'"episode","step"'


@contextmanager
def appearing_whole(target: Path, overwrite: bool = False) -> Iterator[Path]:
    """Yield a path to write to, which is renamed to the target if the block succeeds; else nothing is left.

    Raises:
        UsageError: The target exists, or may not be replaced, or lies within a dataset.
        BusyError: Another process exports to this target.
        IbdataError: The system refuses to write.
    """
    tidy(target)
    _refuse(target, overwrite)
    place = resolved(target)
    with locked_part(place, target) as part:
        if part.receipts:
            raise UsageError(f"{target}: an unfinished run of generate has this name; choose another {OUT}")
        part.clear()
        export = part.folder / "export" / target.name  # a name of its own, because Minari looks at the folder
        export.parent.mkdir()
        try:
            yield export
        except MemoryError:
            raise IbdataError(f"{target}: out of memory; use a smaller history, or one {SPLIT}") from None
        signals.check()  # HDF5 loses exceptions
        files.sync_all(export)
        _refuse(target, overwrite)
        _refuse_others(place, export)
        part.place(export, overwrite)


def _refuse(target: Path, overwrite: bool) -> None:
    """Raise UsageError for a target that lies within a dataset, or exists and is not to be replaced."""
    manifest.refuse_inside(target)
    if os.path.lexists(target) and not overwrite:
        raise UsageError(
            f"{target}: exists already; choose another {OUT}, or {OVERWRITE} to replace an export"
        )
    if os.path.exists(target / manifest.PATH):
        raise UsageError(f"{target}: is a dataset, which no export replaces; choose another {OUT}")
    if (target / "data").is_dir() and not is_folder_export(target):
        raise UsageError(f"{target}: found no export of ibdata; move it away, or choose another {OUT}")
    for file in (target, target / "arrays.parquet"):
        if file.is_file() and not is_export(file):
            raise UsageError(f"{file}: found no export of ibdata; move it away, or choose another {OUT}")


def _refuse_others(place: Path, export: Path) -> None:
    """Raise UsageError if the folder to replace holds anything that the export does not have."""
    for path in place.rglob("*"):
        name = path.relative_to(place)
        if path.match("chunk-*/file-*.parquet") and is_export(path):
            continue  # of LeRobot's format, which numbers its files
        if not ((export / name).exists() or (path.is_file() and files.is_litter(name.name))):
            raise UsageError(f"{place}: found {name}, which is not of such an export; choose another {OUT}")


def library(module: str, format: str, extra: str, package: str | None = None) -> Any:
    """Import an optional library. Raises an error, which names its package, if it is not installed."""
    try:
        return import_module(module)
    except ImportError:
        raise missing(f"exporting to {format}", package or module, extra) from None


def is_folder_export(folder: Path) -> bool:
    """Whether a folder with data/ is a dataset of Minari or LeRobot that `export` has written."""
    tasks = folder / "meta" / "tasks.parquet"  # of LeRobot
    try:
        if tasks.exists():
            return is_export(tasks)
        return "content_root" in json.loads(files.plain_bytes(folder / "data" / "metadata.json"))["view"]
    except (OSError, ValueError, KeyError, TypeError):
        return False


def is_export(path: Path) -> bool:
    """Whether a file is one that `export` has written, or holds nothing."""
    with path.open("rb") as file:
        head = file.read(HEAD)
    try:
        if head.startswith(b"PK"):
            with zipfile.ZipFile(path) as archive:
                return b'"content_root"' in archive.comment
        if head.startswith(b"\x89HDF"):
            import h5py

            with h5py.File(path) as hdf5:
                return "content_root" in str(hdf5.attrs["view"])
        if head.startswith(b"PAR1"):
            import pyarrow.parquet as pq

            return b"content_root" in pq.read_schema(path).metadata[b"view"]
        opened = gzip.open if head.startswith(b"\x1f\x8b") else Path.open
        with opened(path, "rb") as text:
            return not head or text.read(len(CSV)) == CSV
    except Exception:  # whatever the libraries raise for other bytes
        return False


class HDF5(io.FileIO):
    """A new file for HDF5, which does not learn of a write that fails: it would end the process, or go on.

    HDF5 reads what it has written, and would crash without it. So what cannot be written stays in memory.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._error: OSError | None = None
        self._at = self._size = 0
        self._unwritten: list[tuple[int, bytes]] = []

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a position, from the beginning or, with an offset of 0, to the end."""
        self._at = super().seek(offset) if whence == os.SEEK_SET else self._size
        return self._at

    def tell(self) -> int:
        """The position."""
        return self._at

    def write(self, data: Any) -> int:
        """Write all data, unless a write has failed before."""
        view = memoryview(data).cast("B")
        at, self._at = self._at, self._at + len(view)
        self._size = max(self._size, self._at)
        try:
            super().seek(at)
            while view and self._error is None:
                view = view[super().write(view) :]
        except OSError as error:
            self._error = error
        if view:
            self._unwritten.append((self._at - len(view), bytes(view)))
        return len(data)

    def readinto(self, buffer: Any) -> int:
        """Read at the position what was written there."""
        view = memoryview(buffer).cast("B")
        at, self._at = self._at, self._at + len(view)
        view[:] = bytes(len(view))
        super().seek(at)
        super().readinto(view)
        for start, data in self._unwritten:
            first, stop = max(at, start), min(self._at, start + len(data))
            if first < stop:
                view[first - at : stop - at] = data[first - start : stop - start]
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Set the size of the file, unless a write has failed before."""
        self._size = self._size if size is None else size
        try:
            return super().truncate(self._size)
        except OSError as error:
            self._error = self._error or error
            return self._size

    def check(self) -> None:
        """Raise the error of the first write that failed."""
        if self._error is not None:
            raise self._error


@contextmanager
def hdf5_file(path: Path, **options: Any) -> Iterator[tuple[Any, Callable[[], None]]]:
    """A new HDF5 file, and a function that raises OSError if a write to it has failed; so does the end."""
    import h5py

    with HDF5(path) as raw:
        try:
            with h5py.File(raw, "w", **options) as file:
                yield file, raw.check
        finally:
            raw.check()  # also where h5py meets what was not written
