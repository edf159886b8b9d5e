"""One writer a folder: a lock that ends with its process."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ibdata.errors import BusyError

NAME = ".lock"


@contextmanager
def locked(folder: Path, name: str = NAME) -> Iterator[None]:
    """Hold the folder's lock; BusyError at once where another process holds it."""
    path = folder / name
    descriptor = _acquire(path)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)  # before it is released: nobody can hold a lock that has no name
        os.close(descriptor)


def refuse_busy(folder: Path, name: str = NAME) -> None:
    """BusyError where another process holds the folder's lock; nothing is written."""
    try:
        descriptor = os.open(folder / name, os.O_RDWR | os.O_NOFOLLOW)
    except (OSError, ValueError):
        return
    try:
        if not _try(descriptor):
            raise _busy(folder)
    finally:
        os.close(descriptor)


def _acquire(path: Path) -> int:
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
        if not _try(descriptor):
            os.close(descriptor)
            raise _busy(path.parent)
        if _is(path, descriptor):
            return descriptor
        os.close(descriptor)  # its holder removed the file in between; take the new one


def _try(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
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
