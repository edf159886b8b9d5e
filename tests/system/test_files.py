"""Files written whole or not at all, the folders of the cache, and files that macOS leaves beside others."""

import io
import os
import tempfile
from pathlib import Path

import pytest

from ibdata._system.cache_folders import cache_folders
from ibdata._system.files import HashingFile, paths_in, write


@pytest.mark.parametrize(("module", "failing"), [(os, "fsync"), (Path, "replace")])
def test_the_old_file_stays_if_the_system_refuses(monkeypatch, tmp_path, module, failing):
    def refuse(*_):
        raise OSError(28, "No space left on device")

    (tmp_path / "x").write_bytes(b"old")
    monkeypatch.setattr(module, failing, refuse)
    with pytest.raises(OSError, match="No space"):
        write(tmp_path, "x", b"new")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("x", b"old")]


def test_a_file_that_hashes_says_how_much_it_took():
    """Who writes through a buffer writes again what was not taken."""
    assert HashingFile(io.BytesIO()).write(b"abc") == 3


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


@pytest.mark.skipif(os.name == "nt", reason="Windows has no modes")
def test_the_folder_is_for_its_user_alone(tmp_path, monkeypatch):
    """Who may write to it can run machine code as its user."""
    monkeypatch.setenv("IBDATA_CACHE_DIR", str(tmp_path / "asked"))
    before = os.umask(0)
    try:
        cache_folders()
    finally:
        os.umask(before)
    assert (tmp_path / "asked").stat().st_mode & 0o077 == 0


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


def test_only_its_files_are_passed_over(tmp_path):
    for name in (".DS_Store", "._a", ".a", "a", "_a"):
        (tmp_path / name).write_text("")
    (tmp_path / "._folder").mkdir()
    assert [path.name for path in paths_in(tmp_path)] == ["._folder", ".a", "_a", "a"]
