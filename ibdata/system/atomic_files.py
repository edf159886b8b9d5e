"""Writing files that are complete or absent: temporary file, fsync, rename, fsync of the folder."""

from __future__ import annotations

import errno
import hashlib
import io
import os
import re
import secrets
import stat
from collections.abc import Container, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from ibdata.system.disk import sync
from ibdata.system.lock import locked

TEMPORARY = ".tmp-"  # the prefix of temporary files
TOKEN = "{token}"  # stands for random digits in a path
BLOCK = 2**20
PATIENCE = 60.0  # seconds; hundreds of hosts may come at once, and each stays for milliseconds


class FileEntry(NamedTuple):
    """A file of a dataset as the manifest lists it."""

    path: str
    bytes: int
    sha256: str


class HashingFile(io.RawIOBase):
    """A binary file that hashes what is written to it."""

    def __init__(self, raw: BinaryIO, path: str = "") -> None:
        self._raw = raw
        self.path = path
        self._hasher = hashlib.sha256()
        self.size = 0

    def write(self, data: Any) -> int:
        """Write data and hash them."""
        self._hasher.update(data)
        written = self._raw.write(data)
        self.size += written
        return written

    def flush(self) -> None:
        """Hand everything to the operating system."""
        self._raw.flush()

    def sync(self) -> None:
        """Wait until the file's data are on the disk."""
        self._raw.flush()
        sync(self._raw.fileno())

    def sha256(self) -> str:
        """The hex hash of what has been written."""
        return self._hasher.hexdigest()

    def tell(self) -> int:
        """Bytes written so far."""
        return self.size

    def close(self) -> None:
        """Do nothing; whoever opened the raw file closes it."""

    def writable(self) -> bool:
        """True."""
        return True


@contextmanager
def atomic_write(folder: Path, path: str) -> Iterator[HashingFile]:
    """Write a new file, folder/path, that appears under its name only if the block ends without an error.

    `TOKEN` in the path stands for random digits, so that a reader never takes this file for an older one.
    """
    temporary = _temporary(folder, path)
    try:
        with temporary.open("xb") as raw:
            file = HashingFile(raw, path.replace(TOKEN, secrets.token_hex(4)))
            yield file
            file.sync()
        temporary.replace(folder / file.path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync_folder((folder / path).parent)


def write(folder: Path, path: str, data: bytes) -> FileEntry:
    """Write a small file completely or not at all."""
    with atomic_write(folder, path) as file:
        file.write(data)
    return FileEntry(path, file.size, file.sha256())


def create_or_compare(folder: Path, path: str, data: bytes) -> bool:
    """Write a small file unless it exists. Return whether the file holds these bytes."""
    target, temporary = folder / path, _temporary(folder, path)
    if not target.is_file():
        try:
            with temporary.open("xb") as raw:
                file = HashingFile(raw)
                file.write(data)
                file.sync()
            _name(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)
        sync_folder(target.parent)
    try:
        return plain_bytes(target, len(data)) == data
    except OSError:  # a pipe, which might never end, or a longer file
        return False


def _name(temporary: Path, target: Path) -> None:
    """Give a whole file its name, unless another has it; of several that do so at a time, one succeeds."""
    try:
        os.link(temporary, target)
    except FileExistsError:
        pass
    except OSError:  # a file system without links
        with locked(target.parent, f".lock-{target.name}", PATIENCE):
            if not os.path.lexists(target):
                temporary.rename(target)


def _temporary(folder: Path, path: str) -> Path:
    """The path of a new file until it is complete. It is not in a folder of data, nor named like a data file.

    The folder of the complete file is made if it is missing.
    """
    (folder / path).parent.mkdir(exist_ok=True)
    name = Path(path.partition(f"-{TOKEN}")[0]).name
    return folder / f"{TEMPORARY}{secrets.token_hex(6)}-{name}.part"


def file_sha256(path: Path) -> str | None:
    """The hex hash of a regular file, also through a link; None if it cannot be read."""
    hasher = hashlib.sha256()
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        with os.fdopen(descriptor, "rb") as file:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                return None
            while block := file.read(BLOCK):
                hasher.update(block)
    except OSError:
        return None
    return hasher.hexdigest()


def plain_bytes(path: Path, most: int) -> bytes:
    """Read a regular file. Raises OSError if it is larger than `most` bytes, or not a regular file."""
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "not a regular file")
        if status.st_size > most:
            raise OSError(errno.EFBIG, f"larger than {most} bytes")
        return file.read()


def remove_temporaries(folder: Path, names: Container[str] | None = None) -> None:
    """Remove the temporary files of writers that were killed: all, or those of files with these names.

    The name of a shard's file is given without its token. No process may be writing these files.
    """
    for temporary in folder.glob(f"{TEMPORARY}*"):
        found = re.fullmatch(re.escape(TEMPORARY) + r"[0-9a-f]{12}-(.*)\.part", temporary.name, re.DOTALL)
        if found and (names is None or found[1] in names):
            temporary.unlink(missing_ok=True)


def sync_folder(folder: Path) -> None:
    """Wait until the list of files in a folder is on the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        sync(descriptor)
    finally:
        os.close(descriptor)
