"""Locks on folders, for one writer or for several that write different parts; they end with their process.

All are those of flock: they belong to the open file, so that they hold between threads too, and end with a
process however it ends; where NFS keeps locks, it keeps these.
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
PATIENCE = 1.0  # seconds; whoever leaves holds the folder for a moment alone
_mine: dict[Path, int] = {}  # the descriptors of the locks that this process holds
NO_LOCKS = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK)


class _NoLocksError(IbdataError):
    """The file system keeps no locks."""


@contextmanager
def locked(folder: Path, name: str = NAME, patience: float = 0.0) -> Iterator[None]:
    """Hold the folder's lock; BusyError where another process holds it, at once or after some seconds.

    Raises IbdataError where the file system keeps no locks; nothing is left behind.
    """
    path = folder / name
    descriptor = _acquire(path, fcntl.LOCK_EX, patience)
    try:
        yield
    finally:
        _leave(path, descriptor)


@contextmanager
def shared(folder: Path) -> Iterator[ExitStack]:
    """Share the folder's lock with others that do; BusyError where another process has it for itself.

    What is pushed onto the stack is done by the last that leaves, when nobody else is there.
    """
    path = folder / NAME
    descriptor = _acquire(path, fcntl.LOCK_SH, PATIENCE)
    leaving = ExitStack()
    try:
        yield leaving
    finally:
        if _try(folder, descriptor):  # this gives up the shared lock, also where others have theirs still
            leaving.close()
            _leave(path, descriptor)
        else:
            _mine.pop(path, None)
            os.close(descriptor)


def refuse_busy(folder: Path) -> None:
    """BusyError where another process holds the folder's lock; nothing is written."""
    if held(folder / NAME, fcntl.LOCK_EX):
        raise _busy(folder)


def is_locked(folder: Path) -> bool:
    """Whether another process holds the folder's lock, as far as the file system can tell."""
    try:
        return held(folder / NAME, fcntl.LOCK_EX)
    except _NoLocksError:
        return False


def is_lost(folder: Path) -> bool:
    """Whether a lock that this process holds has lost its file: the folder then belongs to another."""
    descriptor = _mine.get(folder / NAME)
    return descriptor is not None and not _is(folder / NAME, descriptor)


def held(path: Path, kind: int = fcntl.LOCK_SH) -> bool:
    """Whether another process holds a lock that excludes one of this kind; nothing is written."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError):
        return False
    try:
        return not _try(path.parent, descriptor, kind)
    finally:
        os.close(descriptor)


def _acquire(path: Path, kind: int, patience: float = 0.0) -> int:
    until = time.monotonic() + patience
    while True:
        new = not os.path.lexists(path)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
        try:
            got = _try(path.parent, descriptor, kind)
        except _NoLocksError:
            os.close(descriptor)
            if new:
                path.unlink(missing_ok=True)
            raise
        if got and _is(path, descriptor):
            _mine[path] = descriptor
            return descriptor
        os.close(descriptor)  # where it was got, its holder removed the file in between; take the new one
        if not got and time.monotonic() >= until:
            raise _busy(path.parent)
        if not got:
            time.sleep(0.02)


def _leave(path: Path, descriptor: int) -> None:
    """Remove the lock's file, if it is still that of this lock, then release it."""
    if _is(path, descriptor):
        path.unlink(missing_ok=True)  # before it is released: nobody can hold a lock that has no name
    _mine.pop(path, None)
    os.close(descriptor)


def _try(folder: Path, descriptor: int, kind: int = fcntl.LOCK_EX) -> bool:
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        raise _NoLocksError(
            f"{folder}: the file system keeps no locks ({error.strerror}); choose a folder elsewhere, or "
            "have it mounted with locks (Lustre: -o flock)"
        ) from None
    return True


def _is(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(os.lstat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _busy(folder: Path) -> BusyError:
    return BusyError(f"{folder}: another process is writing here; wait for it, or choose another --out")
