"""Locks for one writer, or for several that write different files.

A lock is a regular file under flock. It belongs to an open file, so it also works between threads, and it
ends with its process, however that ends. It works on NFS if the mount has locks.
"""

from __future__ import annotations

import errno
import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ibdata.errors import BusyError, IbdataError

NO_LOCKS = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.ENOLCK)  # two numbers on macOS


class Lock:
    """An open lock, held by this process alone or shared with others."""

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path, self._descriptor = path, descriptor

    def take_alone(self) -> bool:
        """Try to hold the lock alone. If others share it, return False; then the lock is lost."""
        return _flock(self._path, self._descriptor, fcntl.LOCK_EX)


@contextmanager
def locked(
    path: Path, patience: float = 0.0, *, shared: bool = False, place: str | os.PathLike[str] | None = None
) -> Iterator[Lock]:
    """Hold the lock of a file, which is made if it is missing, like its folder.

    Args:
        path: The file.
        patience: How many seconds to wait while another process holds the lock.
        shared: Whether other processes may share the lock.
        place: What the lock protects, for messages; by default its folder.

    Raises:
        BusyError: Another process holds the lock.
        IbdataError: The file system has no locks.
    """
    descriptor = _acquired(path, fcntl.LOCK_SH if shared else fcntl.LOCK_EX, patience)
    if descriptor is None:
        raise BusyError(
            f"{place or path.parent}: another process is writing here; wait for it, or choose another --out"
        )
    try:
        yield Lock(path, descriptor)
    finally:
        os.close(descriptor)


def _acquired(path: Path, kind: int, patience: float) -> int | None:
    """A descriptor with the lock, or None if another process still holds it after `patience` seconds."""
    until = time.monotonic() + patience
    while True:
        with suppress(FileExistsError):  # raised too if the folder is removed at this moment
            path.parent.mkdir(parents=True, exist_ok=True)
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
        except FileNotFoundError:  # its folder was removed meanwhile
            if path.parent.is_symlink():  # to nothing
                raise
            continue
        try:
            got = _flock(path, descriptor, kind)
            if got and _is_file_of(path, descriptor):
                return descriptor
        except IbdataError:  # a file system without locks, so that nobody else has this one
            os.close(descriptor)
            path.unlink(missing_ok=True)
            raise
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # a lock that was acquired is on a file that was removed meanwhile: try again
        if not got:
            if time.monotonic() >= until:
                return None
            time.sleep(0.02)


def _flock(path: Path, descriptor: int, kind: int) -> bool:
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        raise IbdataError(
            f"{path.parent}: the file system has no locks ({error.strerror}); choose a folder elsewhere, or "
            "mount it with locks (Lustre: -o flock)"
        ) from None
    return True


def _is_file_of(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(os.lstat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False
