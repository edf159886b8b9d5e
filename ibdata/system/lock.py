"""One writer a folder, or several that write different parts of it: locks that end with their process."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from ibdata.errors import BusyError

NAME = ".lock"
PATIENCE = 1.0  # seconds; whoever leaves holds the folder for a moment alone


@contextmanager
def locked(folder: Path, name: str = NAME) -> Iterator[None]:
    """Hold the folder's lock; BusyError at once where another process holds it."""
    path = folder / name
    descriptor = _acquire(path, fcntl.LOCK_EX)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)  # before it is released: nobody can hold a lock that has no name
        os.close(descriptor)


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
        if _try(descriptor):  # this gives up the shared lock, also where others have theirs still
            leaving.close()
            path.unlink(missing_ok=True)
        os.close(descriptor)


def is_locked(folder: Path, name: str = NAME) -> bool:
    """Whether a process that lives holds the folder's lock; nothing is written."""
    try:
        descriptor = os.open(folder / name, os.O_RDONLY | os.O_NOFOLLOW)
    except (OSError, ValueError):
        return False
    try:
        return not _try(descriptor)
    finally:
        os.close(descriptor)


def refuse_busy(folder: Path, name: str = NAME) -> None:
    """BusyError where another process holds the folder's lock; nothing is written."""
    if is_locked(folder, name):
        raise _busy(folder)


def _acquire(path: Path, kind: int, patience: float = 0.0) -> int:
    until = time.monotonic() + patience
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
        got = _try(descriptor, kind)
        if got and _is(path, descriptor):
            return descriptor
        os.close(descriptor)  # where it was got, its holder removed the file in between; take the new one
        if not got and time.monotonic() >= until:
            raise _busy(path.parent)
        if not got:
            time.sleep(0.02)


def _try(descriptor: int, kind: int = fcntl.LOCK_EX) -> bool:
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _is(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(os.lstat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _busy(folder: Path) -> BusyError:
    return BusyError(f"{folder}: another process is writing here; wait for it, or choose another --out")
