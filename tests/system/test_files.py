"""Files that are written whole or not at all, with their size and hash."""

from __future__ import annotations

import hashlib
import os
import stat
from pathlib import Path

import pytest

from ibdata.system.files import FileEntry, file_sha256, new_file, plain_bytes, remove, write, write_new


class Stop(BaseException):
    """Like KeyboardInterrupt: not an Exception."""


@pytest.mark.parametrize("error", [ValueError, Stop])
def test_an_exception_leaves_no_file(tmp_path, error):
    """A block that raises leaves nothing of its file."""

    def failing():
        with new_file(tmp_path / "data/x") as file:
            file.write(b"half")
            raise error

    with pytest.raises(error):
        failing()
    assert [path.name for path in tmp_path.rglob("*")] == ["data"]


@pytest.mark.parametrize("pieces", [[], [b""], [b"a"], [b"ab", b"c" * 100_000, b"d"]], ids=len)
def test_size_and_hash_are_those_of_the_file(tmp_path, pieces):
    """What is written is counted and hashed on the way."""
    with new_file(tmp_path / "x") as file:
        for i, piece in enumerate(pieces):
            assert file.write(piece) == len(piece)
            assert file.tell() == sum(map(len, pieces[: i + 1]))
    data = (tmp_path / "x").read_bytes()
    assert data == b"".join(pieces)
    assert (file.size, file.sha256()) == (len(data), hashlib.sha256(data).hexdigest())
    assert file_sha256(tmp_path / "x") == file.sha256()


@pytest.mark.parametrize("writer", [write_new, write])
def test_a_small_file_comes_with_its_entry(tmp_path, writer):
    """A file that is written at once comes with its entry for the manifest."""
    digest = "2cf24dba5fb0a30e26e83b2ac5b9e29e1b161e5c1fa7425e73043362938b9824"
    assert writer(tmp_path, "meta/x.json", b"hello") == FileEntry("meta/x.json", 5, digest)
    assert (tmp_path / "meta/x.json").read_bytes() == b"hello"
    assert os.listdir(tmp_path / "meta") == ["x.json"]


@pytest.mark.parametrize("failing", ["fsync", "replace"])
def test_the_old_file_stays_if_the_system_refuses(monkeypatch, tmp_path, failing):
    """A file is replaced in one step: where that fails, the old one is there as it was, and nothing else."""

    def refuse(*_):
        raise OSError(28, "No space left on device")

    (tmp_path / "x").write_bytes(b"old")
    monkeypatch.setattr(os if failing == "fsync" else Path, failing, refuse)
    with pytest.raises(OSError, match="No space"):
        write(tmp_path, "x", b"new")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("x", b"old")]


def test_a_replaced_file_keeps_mode_and_group(tmp_path):
    """The new file has the mode and the group of the old one."""
    (tmp_path / "x").write_bytes(b"old")
    if os.geteuid() == 0:
        os.chown(tmp_path / "x", -1, 12345)
    (tmp_path / "x").chmod(0o604)
    before = (tmp_path / "x").stat()
    write(tmp_path, "x", b"new")
    after = (tmp_path / "x").stat()
    assert (stat.S_IMODE(after.st_mode), after.st_gid) == (0o604, before.st_gid)


@pytest.mark.parametrize("dangling", [False, True])
def test_a_link_is_replaced_and_not_followed(tmp_path, dangling):
    """A link in the place of a file is replaced, and what it leads to stays."""
    victim = tmp_path / "victim"
    if not dangling:
        victim.write_bytes(b"mine")
    (tmp_path / "x").symlink_to(victim)
    write(tmp_path, "x", b"data")
    assert not (tmp_path / "x").is_symlink()
    assert (tmp_path / "x").read_bytes() == b"data"
    assert victim.exists() != dangling
    assert dangling or victim.read_bytes() == b"mine"


def test_only_regular_files_of_a_size_are_read(tmp_path):
    """A pipe, a folder or a file that is too large is an error at once."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "large").write_bytes(b"12345")
    (tmp_path / "link").symlink_to("large")
    for name in ("pipe", "folder", "large", "missing"):
        with pytest.raises(OSError, match=r"regular file|larger than 4|directory"):
            plain_bytes(tmp_path / name, 4)
    assert plain_bytes(tmp_path / "link", 5) == b"12345"
    assert [file_sha256(tmp_path / name) for name in ("pipe", "folder", "missing")] == [None] * 3


def test_removing_a_link_leaves_what_it_leads_to(tmp_path):
    """A file, a folder with files, a link to a folder or nothing is removed, and nothing else."""
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept/file").touch()
    (tmp_path / "link").symlink_to("kept")
    (tmp_path / "folder/inner").mkdir(parents=True)
    for name in ("link", "folder", "missing"):
        remove(tmp_path / name)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "kept"]
