"""Files with checksums, in folders to which only this user or root can write.

These files hold machine code that will be run, so a file that is damaged, or that another user may have
written, must not be read. Folders and files are first opened, without following links, and then the open file
is checked, so that nothing can be put in its place in between.
"""

from __future__ import annotations

import errno
import hashlib
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from uuid import uuid4

CHECKSUM = hashlib.sha256
HEADER = CHECKSUM().digest_size
OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH


def resolved(folder: str) -> str:
    """The absolute path without links. Raises OSError if the folder is a link that another user made."""
    if os.path.islink(folder):
        _refuse_owner(os.lstat(folder), folder)
    return os.path.realpath(folder)


def make(folder: str) -> None:
    """Make a folder and its missing parents, accessible to this user only, whatever the umask is."""
    if not os.path.isdir(folder):
        make(os.path.dirname(folder))
        with suppress(FileExistsError):
            os.mkdir(folder, 0o700)


@contextmanager
def opened(folder: str) -> Iterator[int]:
    """Open a folder and yield its descriptor. Raises OSError if other users can write to it."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        _refuse_others(os.fstat(descriptor), folder)
        yield descriptor
    finally:
        os.close(descriptor)


@contextmanager
def verified(folder: str, name: str) -> Iterator[int]:
    """Open a file and yield its descriptor, positioned after the checksum.

    Raises OSError if the file is damaged, or if other users can write to it. The checksum finds damage only;
    the owner and mode keep other users away.
    """
    with opened(folder) as at:
        descriptor = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=at)
    try:
        status = os.fstat(descriptor)
        _refuse_others(status, name)
        content = b"" if not stat.S_ISREG(status.st_mode) else _content(descriptor)
        if content[:HEADER] != CHECKSUM(content[HEADER:]).digest():
            raise OSError(errno.EIO, "damaged", name)
        os.lseek(descriptor, HEADER, os.SEEK_SET)
        yield descriptor
    finally:
        os.close(descriptor)


def write(folder: str, name: str, content: bytes) -> None:
    """Write a file, completely or not at all. Raises OSError if others can write to the folder."""
    temporary = f".tmp-{uuid4().hex}"
    with opened(folder) as at:
        try:
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
            with open(os.open(temporary, flags, 0o600, dir_fd=at), "wb") as file:
                file.write(CHECKSUM(content).digest() + content)
            os.replace(temporary, name, src_dir_fd=at, dst_dir_fd=at)
        except BaseException:
            with suppress(OSError):
                os.unlink(temporary, dir_fd=at)
            raise


def _content(descriptor: int) -> bytes:
    with open(descriptor, "rb", closefd=False) as file:
        return file.read()


def _refuse_owner(status: os.stat_result, path: str) -> None:
    if status.st_uid not in (0, os.geteuid()):
        raise PermissionError(errno.EPERM, "belongs to another user", path)


def _refuse_others(status: os.stat_result, path: str) -> None:
    _refuse_owner(status, path)
    if status.st_mode & OTHERS_MAY_WRITE:
        raise PermissionError(errno.EPERM, "other users can write to it", path)
