"""Files written whole or not at all, the folders of the cache, and the code for macOS."""

import ctypes
import errno
import fcntl
import os
import tempfile
from pathlib import Path

import pytest

from ibdata.system import files
from ibdata.system.cache_folders import cache_folders
from ibdata.system.files import write
from ibdata.system.part import exchanged
from ibdata.system.processes import available_processors


@pytest.mark.parametrize(("module", "failing"), [(os, "fsync"), (Path, "replace")])
def test_the_old_file_stays_if_the_system_refuses(monkeypatch, tmp_path, module, failing):
    def refuse(*_):
        raise OSError(28, "No space left on device")

    (tmp_path / "x").write_bytes(b"old")
    monkeypatch.setattr(module, failing, refuse)
    with pytest.raises(OSError, match="No space"):
        write(tmp_path, "x", b"new")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("x", b"old")]


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
    """macOS waits for the disk itself once for all files, where the file system knows how."""
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
    assert asked == ["fsync", expected]


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
        files.reserve(file, 1)
        with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
            files.reserve(file, 2**62)


def test_unknown_own_processors_are_those_of_the_machine(monkeypatch):
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert available_processors() == 7


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    """A user with an empty home, and no variables set."""
    for variable in ("IBDATA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    cache_folders.cache_clear()
    yield tmp_path / "home"
    cache_folders.cache_clear()


@pytest.mark.parametrize(
    ("variable", "folder"),
    [("", "home/.cache/ibdata"), ("IBDATA_CACHE_DIR", "asked"), ("XDG_CACHE_HOME", "asked/ibdata")],
)
def test_the_users_cache_or_a_variable_names_the_folder(variable, folder, tmp_path, monkeypatch):
    if variable:
        monkeypatch.setenv(variable, str(tmp_path / "asked"))
    assert cache_folders() == ((str(tmp_path / folder),), True)
    assert (tmp_path / folder).is_dir()


def test_a_read_only_folder_is_only_looked_into(home, tmp_path, monkeypatch):
    """As in a container image, where the user's cache gets what is compiled later."""
    asked = tmp_path / "asked"
    monkeypatch.setenv("IBDATA_CACHE_DIR", str(asked))
    monkeypatch.setattr(os, "access", lambda path, mode: str(path) != str(asked))
    assert cache_folders() == ((str(asked), str(home / ".cache/ibdata")), True)


def test_a_temporary_folder_is_the_last_resort(tmp_path, monkeypatch):
    """Nothing that is written there lasts; and a ~ that stands for nobody is not taken for a name."""
    (tmp_path / "file").write_text("no folder")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "file"))
    monkeypatch.setenv("IBDATA_CACHE_DIR", "~nobody-of-that-name/x")
    found = cache_folders()
    assert not found.lasting
    assert os.path.dirname(found.folders[-1]) == tempfile.gettempdir()
    assert not list(tmp_path.glob("~*"))
