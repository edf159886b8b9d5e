"""The folders for what is kept between processes."""

from __future__ import annotations

import os
import tempfile

import pytest

from ibdata.system.cache_folders import cache_folders


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    """A user with an empty home, and no variables set."""
    for variable in ("IBDATA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    cache_folders.cache_clear()
    yield tmp_path / "home"
    cache_folders.cache_clear()


def test_the_users_cache_is_the_default(home):
    """Without variables, it is the user's cache, which is made."""
    assert cache_folders() == ((str(home / ".cache/ibdata"),), True)
    assert (home / ".cache/ibdata").is_dir()


@pytest.mark.parametrize(("variable", "below"), [("IBDATA_CACHE_DIR", ""), ("XDG_CACHE_HOME", "ibdata")])
def test_a_variable_names_another(variable, below, tmp_path, monkeypatch):
    """Either variable does."""
    monkeypatch.setenv(variable, str(tmp_path / "asked"))
    assert cache_folders() == ((os.path.join(tmp_path, "asked", below).rstrip("/"),), True)


def test_a_read_only_folder_is_only_looked_into(home, tmp_path, monkeypatch):
    """As in a container image, where the user's cache gets what is compiled later."""
    asked = tmp_path / "asked"
    monkeypatch.setenv("IBDATA_CACHE_DIR", str(asked))
    monkeypatch.setattr(os, "access", lambda path, mode: str(path) != str(asked))
    assert cache_folders() == ((str(asked), str(home / ".cache/ibdata")), True)


def test_a_temporary_folder_is_the_last_resort(home, tmp_path, monkeypatch):
    """Nothing that is written there lasts."""
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("HOME", str(tmp_path / "file"))
    found = cache_folders()
    assert not found.lasting
    assert os.path.dirname(found.folders[-1]) == tempfile.gettempdir()


def test_a_user_without_a_home_gets_no_folder_named_tilde(tmp_path, monkeypatch):
    """A ~ that stands for nothing is not taken for a name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("IBDATA_CACHE_DIR", "~nobody-of-that-name/x")
    cache_folders()
    assert not list(tmp_path.glob("~*"))
