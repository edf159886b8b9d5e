"""Files that are whole or not there: temporary file, fsync, rename, fsync of the folder."""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
import stat
from collections.abc import Container, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, NamedTuple

TEMPORARY = ".tmp-"
BLOCK = 2**20


class FileEntry(NamedTuple):
    """A file of a dataset as the manifest lists it."""

    path: str
    bytes: int
    sha256: str


class HashingFile:
    """A binary file being written, hashed on the way."""

    def __init__(self, raw: BinaryIO) -> None:
        self._raw = raw
        self._hasher = hashlib.sha256()
        self.size = 0
        self.closed = False

    def write(self, data: bytes) -> int:
        """Write and hash."""
        self._hasher.update(data)
        self.size += len(data)
        return self._raw.write(data)

    def flush(self) -> None:
        """Hand everything to the operating system."""
        self._raw.flush()

    def sync(self) -> None:
        """Wait until the file's data are on the disk."""
        self._raw.flush()
        os.fsync(self._raw.fileno())

    def sha256(self) -> str:
        """The hex hash of what has been written."""
        return self._hasher.hexdigest()

    def tell(self) -> int:
        """Bytes written so far."""
        return self.size

    def close(self) -> None:
        """Nothing: whoever opened the file closes it."""

    def readable(self) -> bool:
        """Never."""
        return False

    def writable(self) -> bool:
        """Always."""
        return True

    def seekable(self) -> bool:
        """Never."""
        return False

    def __enter__(self) -> HashingFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


@contextmanager
def committed(folder: Path, path: str) -> Iterator[HashingFile]:
    """A new file folder/path that appears under its name when the block ends well, and not otherwise."""
    target, temporary = _places(folder, path)
    try:
        with temporary.open("xb") as raw:
            file = HashingFile(raw)
            yield file
            file.sync()
        temporary.replace(target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync_folder(target.parent)


def write(folder: Path, path: str, data: bytes) -> FileEntry:
    """Commit a small file."""
    with committed(folder, path) as file:
        file.write(data)
    return FileEntry(path, file.size, file.sha256())


def write_once(folder: Path, path: str, data: bytes) -> bool:
    """Commit a small file, of which the first writer decides; whether it holds these bytes then."""
    target, temporary = _places(folder, path)
    if not target.is_file():
        try:
            with temporary.open("xb") as raw:
                file = HashingFile(raw)
                file.write(data)
                file.sync()
            with suppress(FileExistsError):
                os.link(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)
        sync_folder(target.parent)
    return target.read_bytes() == data


def _places(folder: Path, path: str) -> tuple[Path, Path]:
    """Where a new file is to be, and where it is until it is whole."""
    target = folder / path
    target.parent.mkdir(exist_ok=True)
    return target, target.with_name(f"{TEMPORARY}{secrets.token_hex(6)}-{target.name}")


def file_sha256(path: Path) -> str | None:
    """The hex hash of a regular file; None where there is none, or it cannot be read."""
    hasher = hashlib.sha256()
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        with os.fdopen(descriptor, "rb") as file:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                return None
            while block := file.read(BLOCK):
                hasher.update(block)
    except OSError:
        return None
    return hasher.hexdigest()


def plain_bytes(path: Path, most: int) -> bytes:
    """What is in a regular file; OSError where it is something else, which might never end, or larger."""
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "not a regular file")
        if status.st_size > most:
            raise OSError(errno.EFBIG, f"larger than {most} bytes")
        return file.read()


def sweep(folder: Path, names: Container[str] | None = None) -> None:
    """Remove the temporary files of writers that were killed, or just those that were to be these files.

    Call it only where nobody writes them.
    """
    for temporary in folder.glob(f"{TEMPORARY}*"):
        if names is None or temporary.name.removeprefix(TEMPORARY).partition("-")[2] in names:
            temporary.unlink(missing_ok=True)


def sync_folder(folder: Path) -> None:
    """Wait until the folder's names are on the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
