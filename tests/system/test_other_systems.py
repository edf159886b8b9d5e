"""Where Linux and macOS differ, the code for macOS does what macOS documents. Nothing here ran on macOS."""

import ctypes
import errno
import fcntl
import os

import pytest

from ibdata.system import disk
from ibdata.system.exchange import exchanged
from ibdata.system.files import write
from ibdata.system.processes import available_processors

F_FULLFSYNC = 51


@pytest.mark.parametrize(
    ("macos", "number", "expected"),
    [
        (False, 0, "fsync"),
        (True, 0, F_FULLFSYNC),
        (True, errno.ENOTTY, "fsync"),
    ],
)
def test_a_file_and_its_folder_are_synced(monkeypatch, tmp_path, macos, number, expected):
    """macOS waits for the disk itself, where the file system knows how, and other systems use fsync."""
    asked = []

    def control(descriptor, command):
        if number:
            raise OSError(number, os.strerror(number))
        asked.append(command)

    monkeypatch.setattr(os, "fsync", lambda descriptor: asked.append("fsync"))
    if macos:
        monkeypatch.setattr(fcntl, "F_FULLFSYNC", F_FULLFSYNC, raising=False)
        monkeypatch.setattr(fcntl, "fcntl", control)
    write(tmp_path, "x", b"data")
    assert asked == [expected] * 2


class MacOS:
    """A C library with renamex_np, and without renameat2."""

    def __init__(self, number=0):
        self.number, self.called = number, []

    def __call__(self, name, use_errno):
        return self

    def renamex_np(self, a, b, flags):
        self.called.append((a, b, flags))
        ctypes.set_errno(self.number)
        return -1 if self.number else 0


@pytest.mark.parametrize(("number", "done"), [(0, True), (errno.ENOTSUP, False)])
def test_macos_exchanges_folders_by_its_own_call(monkeypatch, tmp_path, number, done):
    """Where the file system cannot exchange, that is no error; the caller uses two renames."""
    library = MacOS(number)
    monkeypatch.setattr(ctypes, "CDLL", library)
    assert exchanged(tmp_path / "a", tmp_path / "b") is done
    assert library.called == [(os.fsencode(tmp_path / "a"), os.fsencode(tmp_path / "b"), 2)]


def test_room_is_asked_for_where_it_cannot_be_reserved(monkeypatch, tmp_path):
    monkeypatch.delattr(os, "posix_fallocate")
    with (tmp_path / "file").open("wb") as file:
        disk.reserve(file.fileno(), 1)
        with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
            disk.reserve(file.fileno(), 2**62)


def test_the_processors_of_the_machine_count_where_its_own_are_unknown(monkeypatch):
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert available_processors() == 7
