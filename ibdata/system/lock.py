"""Locks on folders, for one writer or for several that write different parts.

They use flock. Such a lock belongs to an open file, so it also works between threads, and it ends with its
process, however that ends. It works on NFS if the mount has locks.
"""

from __future__ import annotations

import errno
import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from ibdata.errors import BusyError, IbdataError

NAME = ".lock"
PATIENCE = 1.0  # seconds; a process that gives up a shared lock holds the folder alone for a moment
_mine: dict[Path, int] = {}  # the descriptors of the locks that this process holds
NO_LOCKS = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.ENOLCK)  # two numbers on macOS


class _NoLocksError(IbdataError):
    """The file system has no locks."""


@contextmanager
def locked(folder: Path, name: str = NAME, patience: float = 0.0) -> Iterator[None]:
    """Hold the folder's lock. Raises BusyError if another process still holds it after `patience` seconds.

    Raises IbdataError if the file system has no locks; nothing is left behind.
    """
    path = folder / name
    descriptor = _acquire(path, fcntl.LOCK_EX, patience)
    try:
        yield
    finally:
        _leave(path, descriptor)


@contextmanager
def shared(folder: Path) -> Iterator[ExitStack]:
    """Share the folder's lock. Raises BusyError if another process holds it alone.

    At the end, the callbacks of the yielded stack are called, but only if no other process shares the lock
    then.
    """
    path = folder / NAME
    descriptor = _acquire(path, fcntl.LOCK_SH, PATIENCE)
    leaving = ExitStack()
    try:
        yield leaving
    finally:
        if _try_lock(folder, descriptor):  # gives up the shared lock, even if others still hold theirs
            leaving.close()
            _leave(path, descriptor)
        else:
            _mine.pop(path, None)
            os.close(descriptor)


def refuse_busy(folder: Path) -> None:
    """Raise BusyError if another process holds the folder's lock; write nothing."""
    if held(folder / NAME, fcntl.LOCK_EX):
        raise _busy(folder)


def is_locked(folder: Path) -> bool:
    """Whether another process holds the folder's lock, as far as the file system can tell."""
    try:
        return held(folder / NAME, fcntl.LOCK_EX)
    except _NoLocksError:
        return False


def is_lost(folder: Path) -> bool:
    """Whether the file of a lock that this process holds is gone: the folder then belongs to another one."""
    descriptor = _mine.get(folder / NAME)
    return descriptor is not None and not _is_file_of(folder / NAME, descriptor)


def held(path: Path, kind: int = fcntl.LOCK_SH) -> bool:
    """Whether another process holds a lock that excludes one of this kind. Writes nothing."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError):
        return False
    try:
        return not _try_lock(path.parent, descriptor, kind)
    finally:
        os.close(descriptor)


def _acquire(path: Path, kind: int, patience: float = 0.0) -> int:
    until = time.monotonic() + patience
    while True:
        new = not os.path.lexists(path)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
        try:
            got = _try_lock(path.parent, descriptor, kind)
        except _NoLocksError:
            os.close(descriptor)
            if new:
                path.unlink(missing_ok=True)
            raise
        if got and _is_file_of(path, descriptor):
            _mine[path] = descriptor
            return descriptor
        os.close(descriptor)  # a lock that was acquired is on a file that was removed meanwhile: try again
        if not got and time.monotonic() >= until:
            raise _busy(path.parent)
        if not got:
            time.sleep(0.02)


def _leave(path: Path, descriptor: int) -> None:
    """Remove the lock's file, if it is still that of this lock, then release it."""
    if _is_file_of(path, descriptor):
        path.unlink(missing_ok=True)  # before the release, so that no other process gets a lock on this file
    _mine.pop(path, None)
    os.close(descriptor)


def _try_lock(folder: Path, descriptor: int, kind: int = fcntl.LOCK_EX) -> bool:
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        raise _NoLocksError(
            f"{folder}: the file system has no locks ({error.strerror}); choose a folder elsewhere, or "
            "mount it with locks (Lustre: -o flock)"
        ) from None
    return True


def _is_file_of(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(os.lstat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _busy(folder: Path) -> BusyError:
    return BusyError(f"{folder}: another process is writing here; wait for it, or choose another --out")
