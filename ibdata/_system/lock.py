"""Locks for one writer, or for several that write different files.

A lock is a regular file under flock, or LockFileEx of Windows. It belongs to an open file, so it also works
between threads, and it ends with its process, however that ends. It works on NFS if the mount has locks.
"""

from __future__ import annotations

import errno
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ibdata.errors import OUT, BusyError, IbdataError

OPEN = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)
NO_LOCKS = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.ENOLCK)  # two numbers on macOS


class Lock:
    """An open lock, held by this process alone or shared with others."""

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path, self._descriptor = path, descriptor
        self.goes = False

    def take_alone(self) -> bool:
        """Try to hold the lock alone. If others share it, return False; then the lock is lost."""
        return _lock(self._path, self._descriptor, shared=False)

    def remove(self) -> None:
        """Remove the file; under Windows, which removes no open file, when the lock ends."""
        self.goes = sys.platform == "win32"
        if not self.goes:
            self._path.unlink(missing_ok=True)


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
    descriptor = _acquired(path, shared, patience)
    if descriptor is None:
        raise BusyError(
            f"{place or path.parent}: another process is writing here; wait for it, or choose another {OUT}"
        )
    lock = Lock(path, descriptor)
    try:
        yield lock
    finally:
        os.close(descriptor)
        if lock.goes:
            with suppress(OSError):  # another process has opened it meanwhile
                path.unlink()


def _acquired(path: Path, shared: bool, patience: float) -> int | None:
    """A descriptor with the lock, or None if another process still holds it after `patience` seconds."""
    until = time.monotonic() + patience
    while True:
        with suppress(FileExistsError):  # raised too if the folder is removed at this moment
            path.parent.mkdir(parents=True, exist_ok=True)
        try:
            descriptor = os.open(path, OPEN, 0o666)
        except FileNotFoundError:  # its folder was removed meanwhile
            if path.parent.is_symlink():  # to nothing
                raise
            continue
        try:
            got = _lock(path, descriptor, shared)
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


def _lock(path: Path, descriptor: int, shared: bool) -> bool:
    try:
        _lock_at_once(descriptor, shared)
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


if sys.platform == "win32":
    import ctypes
    import msvcrt

    FAIL_AT_ONCE, EXCLUSIVE, TAKEN = 1, 2, 33  # flags of LockFileEx, and its error

    def _lock_at_once(descriptor: int, shared: bool) -> None:
        kernel = ctypes.WinDLL("kernel32", use_last_error=True)
        handle = ctypes.c_void_p(msvcrt.get_osfhandle(descriptor))
        byte = (ctypes.c_uint32 * 8)(0, 0, 0, 0, 0, 2**30)  # OVERLAPPED: one far behind the file's end
        kernel.UnlockFileEx(handle, 0, 1, 0, byte)  # because a lock cannot be changed
        if not kernel.LockFileEx(handle, FAIL_AT_ONCE | (0 if shared else EXCLUSIVE), 0, 1, 0, byte):
            number = ctypes.get_last_error()
            raise BlockingIOError if number == TAKEN else ctypes.WinError(number)

else:

    def _lock_at_once(descriptor: int, shared: bool) -> None:
        import fcntl

        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
