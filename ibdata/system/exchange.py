"""Two folders that change places in one system call, and whether the system would move a folder at all."""

from __future__ import annotations

import ctypes
import errno
import os
from pathlib import Path

AT_FDCWD, RENAME_EXCHANGE, RENAME_SWAP = -100, 2, 2


def exchanged(a: Path, b: Path) -> bool:
    """Let two folders change places in one system call; False where there is none that can.

    The call is Linux's renameat2, or macOS's renamex_np, which has not been tried on macOS.
    """
    library, names = ctypes.CDLL(None, use_errno=True), (os.fsencode(a), os.fsencode(b))
    if hasattr(library, "renameat2"):
        failed = library.renameat2(AT_FDCWD, names[0], AT_FDCWD, names[1], RENAME_EXCHANGE)
    elif hasattr(library, "renamex_np"):
        failed = library.renamex_np(*names, RENAME_SWAP)
    else:
        return False
    if not failed:
        return True
    number = ctypes.get_errno()
    if number in (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP):
        return False
    raise OSError(number, os.strerror(number), str(b))


def refuse_immovable(folder: Path, full: Path) -> None:
    """Raise OSError where the system would not move a folder, such as a mount, or one that is read-only.

    Args:
        folder: The folder, which stays where it is.
        full: A folder elsewhere that holds something. No folder can replace it, so trying tells the reason.
    """
    try:
        folder.rename(full)
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise naming(folder, error) from error
    else:  # against POSIX
        full.rename(folder)
        raise OSError(errno.ENOTSUP, "the file system lets a folder replace one that holds something")


def naming(path: Path, error: OSError) -> OSError:
    """The error with the name of the file or folder that it is about."""
    return OSError(error.errno, f"{path.name}: {error.strerror}")
