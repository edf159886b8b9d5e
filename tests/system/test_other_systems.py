"""Where Linux and macOS differ, the code for macOS does what macOS documents. Nothing here ran on macOS."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os

import pytest

from ibdata.system import disk
from ibdata.system.exchange import exchanged
from ibdata.system.processes import available_processors

F_FULLFSYNC = 51


@pytest.fixture
def opened(tmp_path):
    with (tmp_path / "file").open("wb") as file:
        yield file.fileno()


@pytest.fixture
def synced(monkeypatch):
    """What the disk is asked, in order."""
    asked = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: asked.append("fsync"))
    return asked


def test_linux_syncs_by_fsync(opened, synced):
    disk.sync(opened)
    assert synced == ["fsync"]


def test_macos_waits_for_the_disk_itself(monkeypatch, opened, synced):
    monkeypatch.setattr(fcntl, "F_FULLFSYNC", F_FULLFSYNC, raising=False)
    monkeypatch.setattr(fcntl, "fcntl", lambda descriptor, command: synced.append(command))
    disk.sync(opened)
    assert synced == [F_FULLFSYNC]


@pytest.mark.parametrize("number", [errno.ENOTSUP, errno.EINVAL, errno.ENOTTY])
def test_macos_falls_back_to_fsync_on_other_file_systems(monkeypatch, opened, synced, number):
    def refuse(descriptor, command):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "F_FULLFSYNC", F_FULLFSYNC, raising=False)
    monkeypatch.setattr(fcntl, "fcntl", refuse)
    disk.sync(opened)
    assert synced == ["fsync"]


def test_a_folder_is_synced_in_the_same_way(monkeypatch, tmp_path, synced):
    from ibdata.system.atomic_files import write

    monkeypatch.setattr(fcntl, "F_FULLFSYNC", F_FULLFSYNC, raising=False)
    monkeypatch.setattr(fcntl, "fcntl", lambda descriptor, command: synced.append(command))
    write(tmp_path, "x", b"data")
    assert synced == [F_FULLFSYNC, F_FULLFSYNC]  # the file, then its folder


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


def test_macos_exchanges_folders_by_its_own_call(monkeypatch, tmp_path):
    library = MacOS()
    monkeypatch.setattr(ctypes, "CDLL", library)
    assert exchanged(tmp_path / "a", tmp_path / "b")
    assert library.called == [(os.fsencode(tmp_path / "a"), os.fsencode(tmp_path / "b"), 2)]


def test_a_file_system_of_macos_that_cannot_exchange_is_no_error(monkeypatch, tmp_path):
    monkeypatch.setattr(ctypes, "CDLL", MacOS(errno.ENOTSUP))
    assert not exchanged(tmp_path / "a", tmp_path / "b")


def test_another_refusal_of_macos_is_one(monkeypatch, tmp_path):
    monkeypatch.setattr(ctypes, "CDLL", MacOS(errno.EPERM))
    with pytest.raises(PermissionError):
        exchanged(tmp_path / "a", tmp_path / "b")


def test_a_system_without_either_call_exchanges_nothing(monkeypatch, tmp_path):
    monkeypatch.setattr(ctypes, "CDLL", lambda name, use_errno: object())
    assert not exchanged(tmp_path / "a", tmp_path / "b")


def test_room_is_asked_for_where_it_cannot_be_reserved(monkeypatch, opened):
    monkeypatch.delattr(os, "posix_fallocate")
    disk.reserve(opened, 1)
    with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
        disk.reserve(opened, 2**62)


def test_the_processors_of_the_machine_count_where_those_of_the_process_are_unknown(monkeypatch):
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert available_processors() == 7
