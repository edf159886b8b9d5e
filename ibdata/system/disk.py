"""Room on the disk, and waiting until data are on it, where systems differ."""

from __future__ import annotations

import errno
import fcntl
import os


def sync(descriptor: int) -> None:
    """Wait until the data of an open file or folder are on the disk.

    On macOS, fsync returns when the disk has the data in its own memory, and F_FULLFSYNC when they are safe.
    File systems that do not know it, such as those of a network, get an fsync.
    """
    full = getattr(fcntl, "F_FULLFSYNC", None)
    if full is not None:
        try:
            fcntl.fcntl(descriptor, full)
            return
        except OSError:
            pass
    os.fsync(descriptor)


def reserve(descriptor: int, size: int) -> None:
    """Make an open file as large as this. Raises OSError if there is no room.

    Where the system cannot reserve room, such as on macOS, this only asks how much there is.
    """
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(descriptor, 0, size)
        return
    space = os.fstatvfs(descriptor)
    if size > space.f_bavail * space.f_frsize:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
