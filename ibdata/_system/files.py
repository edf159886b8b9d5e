"""Writing files that are on the disk when a call returns, and reading files of which nothing is known."""

from __future__ import annotations

import errno
import hashlib
import io
import math
import os
import shutil
import stat
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, BinaryIO, NamedTuple

BLOCK = 2**20
HASH_BYTES = 32  # of the SHA-256 at the end of a file with a hash
MOST_HASHED = 2**32  # bytes
WAITING = 8  # files for which `sync_all` waits at a time
READ = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
TRIES = 20 if sys.platform == "win32" else 1  # of a rename


class FileEntry(NamedTuple):
    """A file of a dataset as the manifest lists it."""

    path: str
    bytes: int
    sha256: str


class HashingFile(io.RawIOBase):
    """A binary file that hashes what is written to it."""

    def __init__(self, raw: IO[bytes]) -> None:
        self._raw = raw
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
def new_file(path: Path, waits: bool = True) -> Iterator[HashingFile]:
    """Write a file, which is on the disk at the end of the block if it waits, and gone if the block raises.

    The entry in its folder may not be on the disk yet: `sync_folder` waits for that, and `sync_all` for
    everything. The folder is made if it is missing.
    """
    path.parent.mkdir(exist_ok=True)
    try:
        with path.open("wb") as raw:
            yield HashingFile(raw)
            raw.flush()
            if waits:
                os.fsync(raw.fileno())
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def write_new(folder: Path, path: str, data: bytes, waits: bool = True) -> FileEntry:
    """Write folder/path, a file that nobody reads yet."""
    with new_file(folder / path, waits) as file:
        file.write(data)
    return FileEntry(path, file.size, file.sha256())


def entry_of(path: str, data: bytes) -> FileEntry:
    """The entry of a file with a path and a content."""
    return FileEntry(path, len(data), hashlib.sha256(data).hexdigest())


def write(folder: Path, path: str, data: bytes) -> FileEntry:
    """Write folder/path in place of an older file, whose mode and group it gets.

    Readers find the old file or the new one, never a part of it. Nobody else may write it at the same time.
    """
    target = folder / path
    temporary = part_of(target)
    entry = write_new(temporary.parent, temporary.name, data)
    try:
        keep_access(target, temporary)
        rename(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync_folder(target.parent)
    return entry._replace(path=path)


def rename(path: Path, new: Path) -> None:
    """Give a file or folder another name, perhaps that of a file, which it replaces.

    Windows refuses this while a program has a file of it open, as a virus scanner has for a moment.
    """
    for tries in range(TRIES):
        try:
            path.replace(new)
            return
        except PermissionError as error:
            if tries == TRIES - 1:
                if sys.platform == "win32":
                    error.strerror = "refused by Windows, perhaps because a program has a file of it open"
                raise
            time.sleep(0.05)


def part_of(target: Path) -> Path:
    """The hidden name beside a place, under which what is to appear there is made."""
    return target.parent / f".{target.name}.part"  # also of /, which has no name


def keep_access(old: Path, new: Path) -> None:
    """Give a file or folder the mode and the group of another, as far as it exists and the system allows.

    Its owner may read it in any case.
    """
    if not old.exists():
        return
    status = old.stat()
    with suppress(OSError):
        if hasattr(os, "chown"):  # not under Windows
            os.chown(new, -1, status.st_gid)
    with suppress(OSError):
        new.chmod(stat.S_IMODE(status.st_mode) | stat.S_IRUSR)


def file_sha256(path: Path) -> str | None:
    """The hex hash of a regular file, also through a link; None if it cannot be read."""
    hasher = hashlib.sha256()
    try:
        with open_regular(path) as file:
            while block := file.read(BLOCK):
                hasher.update(block)
    except OSError:
        return None
    return hasher.hexdigest()


def open_regular(path: Path) -> BinaryIO:
    """Open a regular file, also through a link. Raises OSError for another, such as an endless pipe."""
    descriptor = os.open(path, READ)
    if stat.S_ISREG(os.fstat(descriptor).st_mode):
        return os.fdopen(descriptor, "rb")
    os.close(descriptor)
    raise OSError(errno.EINVAL, "not a regular file")


def plain_bytes(path: Path, most: float = math.inf) -> bytes:
    """Read a regular file. Raises OSError if it is larger than `most` bytes, or not a regular file."""
    with open_regular(path) as file:
        if os.fstat(file.fileno()).st_size > most:
            raise OSError(errno.EFBIG, f"larger than {most} bytes")
        return file.read()


def with_hash(data: bytes) -> bytes:
    """Data with their hash behind them, for a file that `read_hashed` reads."""
    return data + hashlib.sha256(data).digest()


def read_hashed(path: Path) -> bytes:
    """Read the data of a file with a hash. Raises ValueError if they are not what was written."""
    return without_hash(plain_bytes(path, MOST_HASHED))


def without_hash(content: bytes) -> bytes:
    """The data of what was read of a file with a hash. Raises ValueError if they are not what was written."""
    data = content[:-HASH_BYTES]
    if with_hash(data) != content:
        raise ValueError("not what was written")
    return data


def is_litter(name: str) -> bool:
    """Whether macOS leaves files of this name: .DS_Store, and ._NAME with the attributes of NAME."""
    return name == ".DS_Store" or name.startswith("._")


def paths_in(folder: Path) -> list[Path]:
    """The files and folders in a folder, in order, but for the files that macOS leaves."""
    paths = (folder / name for name in sorted(os.listdir(folder)))
    return [path for path in paths if not is_litter(path.name) or path.is_dir()]


def remove(path: Path) -> None:
    """Remove a file or a whole folder, as far as it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def reserve(file: IO[Any], size: int) -> None:
    """Make an open file as large as this. Raises OSError if there is no room.

    Where the system cannot reserve room, such as on macOS, this only asks how much there is.
    """
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.fileno(), 0, size)
    elif size > shutil.disk_usage(Path(file.name).parent).free:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def sync_folder(folder: Path) -> None:
    """Wait until the list of files in a folder is on the disk, and all files that were synced before.

    On macOS, fsync returns when the disk has the data in its own memory, and F_FULLFSYNC when all that it has
    there are safe. File systems that do not know it, such as those of a network, get an fsync. Windows syncs
    no folders.
    """
    if sys.platform == "win32":
        return
    import fcntl

    full = getattr(fcntl, "F_FULLFSYNC", None)
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        if full is not None:
            with suppress(OSError):
                fcntl.fcntl(descriptor, full)
                return
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_all(place: Path) -> None:
    """Wait until a file, or a folder with all that is in it, is on the disk."""
    paths = [place, *place.rglob("*")]
    folders = [path for path in paths if path.is_dir()]
    files = [path for path in paths if not path.is_dir()]
    with ThreadPoolExecutor(WAITING) as threads:  # the disk takes as long for several files as for one
        list(threads.map(_sync_file, files))
    for folder in reversed(folders):  # the inner ones first
        sync_folder(folder)


def _sync_file(path: Path) -> None:
    descriptor = os.open(path, os.O_RDWR if sys.platform == "win32" else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
