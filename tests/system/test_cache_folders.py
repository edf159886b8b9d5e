"""The folders in which machine code is found, and those to which it is written."""

from __future__ import annotations

import errno
import os
import tempfile
from pathlib import Path

import pytest

from ibdata.system import cache_folders, private_files
from ibdata.system.cache_folders import PASSING, Places, cache_base

NAME = "numba-0123"


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    """A user with an empty home, an empty folder for temporary files, and no variables set."""
    for name in ("home", "tmp", "here"):
        (tmp_path / name).mkdir(mode=0o700)
    for variable in ("IBDATA_CACHE_DIR", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME", PASSING):
        monkeypatch.setenv(variable, "")  # so that it is put back
        monkeypatch.delenv(variable)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "home"


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """The folder that IBDATA_CACHE_DIR names."""
    folder = tmp_path / "asked"
    folder.mkdir(mode=0o700)
    monkeypatch.setenv("IBDATA_CACHE_DIR", str(folder))
    return folder


@pytest.fixture
def no_space(monkeypatch):
    """Let writing fail in folders below these."""

    def full(*folders):
        def write(folder, name, content):
            if any(str(Path(folder)).startswith(str(full)) for full in folders):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), folder)
            private_files.write(folder, name, content)

        monkeypatch.setattr(cache_folders, "write", write)

    return full


@pytest.fixture
def read_only(monkeypatch):
    """Let folders be read only, to root too."""
    access = os.access

    def fix(folder):
        folder.chmod(0o500)
        monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != folder and access(path, mode))

    yield fix
    monkeypatch.undo()


def kept(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if path.is_file())


def passing(tmp_path: Path) -> Path:
    [folder] = (tmp_path / "tmp").iterdir()
    return folder / NAME


def test_the_users_cache_is_the_place_where_nothing_is_asked_for(home):
    places = Places(NAME)
    assert places.folders == [str(home / ".cache/ibdata" / NAME)]
    assert places.lasting
    assert cache_base() == str(home / ".cache/ibdata")


def test_what_is_asked_for_comes_first_and_then_nothing_else_is_looked_at(asked, home):
    places = Places(NAME)
    places.keep("file", b"code")
    assert places.folders == [str(asked / NAME)]
    assert kept(asked) == ["file"]
    assert list(home.iterdir()) == []
    assert cache_base() == str(asked)


def test_a_folder_that_is_asked_for_may_begin_at_home_or_here(home, tmp_path, monkeypatch):
    monkeypatch.setenv("IBDATA_CACHE_DIR", "~/mine")
    assert Places(NAME).folders == [str(home / "mine" / NAME)]
    monkeypatch.setenv("IBDATA_CACHE_DIR", "mine")
    assert Places(NAME).folders == [str(tmp_path / "here" / "mine" / NAME)]


@pytest.mark.parametrize("mode", [0o720, 0o702, 0o777, 0o1777])
def test_a_base_that_others_can_write_to_is_passed_over_and_left_as_it_is(asked, home, mode):
    asked.chmod(mode)
    assert Places(NAME).folders == [str(home / ".cache/ibdata" / NAME)]
    assert list(asked.iterdir()) == []
    assert cache_base() == str(home / ".cache/ibdata")


@pytest.mark.parametrize("mode", [0o720, 0o702, 0o777])
def test_a_folder_that_somebody_has_prepared_is_passed_over(asked, home, mode):
    (asked / NAME).mkdir()
    (asked / NAME).chmod(mode)
    assert Places(NAME).folders == [str(home / ".cache/ibdata" / NAME)]


def test_a_link_in_the_place_of_the_folder_is_passed_over(asked, home, tmp_path):
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    (asked / NAME).symlink_to(tmp_path / "elsewhere")
    assert Places(NAME).folders == [str(home / ".cache/ibdata" / NAME)]


def test_a_read_only_folder_is_read_and_the_next_written(asked, home, read_only, no_space):
    Places(NAME).keep("file", b"code")
    read_only(asked / NAME)
    no_space(asked)
    places = Places(NAME)
    assert places.folders == [str(asked / NAME), str(home / ".cache/ibdata" / NAME)]
    places.keep("more", b"code")
    assert (kept(asked), kept(home)) == (["file"], ["more"])


def test_where_the_file_system_is_full_the_temporary_folder_is_used_by_workers_too(asked, tmp_path, no_space):
    places = Places(NAME)
    no_space(asked)
    places.keep("file", b"code")
    places.keep("more", b"code")
    assert places.folders == [str(asked / NAME), str(passing(tmp_path))]
    assert kept(passing(tmp_path)) == ["file", "more"]
    assert Places(NAME).folders == places.folders  # of a worker, which has this environment


def test_where_everything_is_full_nothing_is_kept(asked, tmp_path, no_space):
    no_space(tmp_path)
    places = Places(NAME)
    places.keep("file", b"code")
    assert kept(asked) == kept(tmp_path / "tmp") == []


def test_where_there_is_no_folder_for_temporary_files_nothing_is_kept(asked, tmp_path, no_space, monkeypatch):
    no_space(asked)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    places = Places(NAME)
    places.keep("file", b"code")
    assert kept(asked) == []


@pytest.mark.parametrize("cache", [None, "~unknown/x", "relative"])
def test_without_a_home_the_temporary_folder_is_used_and_none_here(tmp_path, monkeypatch, cache):
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # neither HOME nor an entry for the user
    if cache:
        monkeypatch.setenv("XDG_CACHE_HOME", cache)
    assert Places(NAME).folders == [str(passing(tmp_path))]
    assert not Places(NAME).lasting
    assert cache_base() == str(passing(tmp_path).parent)
    assert list((tmp_path / "here").iterdir()) == []


def test_an_unknown_users_home_is_no_folder_here(home, tmp_path, monkeypatch):
    monkeypatch.setenv("IBDATA_CACHE_DIR", "~nobody-of-this-name/x")
    assert Places(NAME).folders == [str(home / ".cache/ibdata" / NAME)]
    assert list((tmp_path / "here").iterdir()) == []
