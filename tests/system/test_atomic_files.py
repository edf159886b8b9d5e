"""A file is complete or absent, and its name reaches the disk after its data."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from ibdata.system.atomic_files import FileEntry, atomic_write, create_or_compare, write


class Stop(BaseException):
    """Like KeyboardInterrupt: not an Exception."""


def interrupted(folder, path, error):
    with atomic_write(folder, path) as file:
        file.write(b"half")
        file.flush()
        raise error


@pytest.mark.parametrize("error", [ValueError, Stop, KeyboardInterrupt])
def test_an_exception_leaves_nothing(tmp_path, error):
    with pytest.raises(error):
        interrupted(tmp_path, "data/x.parquet", error)
    assert [path.name for path in tmp_path.rglob("*")] == ["data"]


def test_an_exception_leaves_the_file_that_was_there(tmp_path):
    (tmp_path / "x").write_bytes(b"old")
    with pytest.raises(Stop):
        interrupted(tmp_path, "x", Stop)
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("x", b"old")]


@pytest.mark.parametrize("failing", ["fsync", "rename"])
def test_a_system_that_refuses_leaves_nothing(monkeypatch, tmp_path, failing):
    def refuse(*_):
        raise OSError(28, "No space left on device")

    if failing == "fsync":
        monkeypatch.setattr(os, "fsync", refuse)
    else:
        monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(OSError, match="No space"):
        write(tmp_path, "x", b"data")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("links", [True, False])
def test_of_several_that_create_one_file_one_succeeds(monkeypatch, tmp_path, links):
    def refuse(*_):
        raise OSError(errno.EPERM, "Operation not permitted")

    if not links:
        monkeypatch.setattr(os, "link", refuse)
    monkeypatch.setattr(Path, "is_file", lambda path: False)  # all of them come before the first is done
    with ThreadPoolExecutor(8) as threads:
        same = list(threads.map(lambda i: create_or_compare(tmp_path, ".run/x", b"%d" % (i % 4)), range(16)))
    assert [path.name for path in (tmp_path / ".run").iterdir()] == ["x"]
    assert same == [b"%d" % (i % 4) == (tmp_path / ".run/x").read_bytes() for i in range(16)]
    assert [path.name for path in tmp_path.iterdir()] == [".run"]


def test_no_file_shows_under_its_name_before_the_block_ends(tmp_path):
    with atomic_write(tmp_path, "meta/x") as file:
        file.write(b"first")
        file.flush()
        (temporary,) = (path for path in tmp_path.iterdir() if path.is_file())
        assert re.fullmatch(r"\.tmp-[0-9a-f]{12}-x\.part", temporary.name)
        assert temporary.read_bytes() == b"first"
        assert list((tmp_path / "meta").iterdir()) == []
        file.write(b", second")
    assert [path.name for path in tmp_path.iterdir()] == ["meta"]
    assert [path.name for path in (tmp_path / "meta").iterdir()] == ["x"]
    assert (tmp_path / "meta/x").read_bytes() == b"first, second"


def test_the_old_content_shows_until_the_new_one_is_whole(tmp_path):
    (tmp_path / "x").write_bytes(b"old")
    with atomic_write(tmp_path, "x") as file:
        file.write(b"new")
        file.flush()
        assert (tmp_path / "x").read_bytes() == b"old"
    assert (tmp_path / "x").read_bytes() == b"new"


@pytest.mark.parametrize("dangling", [False, True])
def test_a_symlink_is_replaced_and_not_followed(tmp_path, dangling):
    victim = tmp_path / "victim"
    if not dangling:
        victim.write_bytes(b"mine")
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "x").symlink_to(victim)
    write(folder, "x", b"data")
    assert not (folder / "x").is_symlink()
    assert (folder / "x").read_bytes() == b"data"
    assert victim.exists() != dangling
    assert dangling or victim.read_bytes() == b"mine"


def test_a_symlink_under_the_temporary_name_is_not_followed(monkeypatch, tmp_path):
    monkeypatch.setattr("secrets.token_hex", lambda n: "known")
    (tmp_path / "victim").write_bytes(b"mine")
    (tmp_path / ".tmp-known-x.part").symlink_to("victim")
    with pytest.raises(FileExistsError):
        write(tmp_path, "x", b"data")
    assert (tmp_path / "victim").read_bytes() == b"mine"


def test_two_writers_of_one_name_do_not_meet(tmp_path):
    with atomic_write(tmp_path, "x") as one, atomic_write(tmp_path, "x") as other:
        one.write(b"one")
        other.write(b"other")
    assert (tmp_path / "x").read_bytes() == b"one"
    assert len(list(tmp_path.iterdir())) == 1


def test_the_data_are_on_the_disk_before_the_name_and_the_name_before_the_return(monkeypatch, tmp_path):
    done = []
    fsync, replace = os.fsync, Path.replace

    def recorded_fsync(descriptor):
        status = os.fstat(descriptor)
        folder = stat.S_ISDIR(status.st_mode)
        shown = (tmp_path / "data/x").exists()
        done.append(("fsync", "folder" if folder else status.st_size, shown))
        if folder:
            assert os.path.samestat(status, (tmp_path / "data").stat())
        fsync(descriptor)

    def recorded_replace(path, target):
        done.append(("rename", path.stat().st_size, Path(target).name))
        return replace(path, target)

    monkeypatch.setattr(os, "fsync", recorded_fsync)
    monkeypatch.setattr(Path, "replace", recorded_replace)
    write(tmp_path, "data/x", b"12345")
    assert done == [("fsync", 5, False), ("rename", 5, "x"), ("fsync", "folder", True)]


def test_a_token_in_a_path_becomes_random_digits(tmp_path):
    with atomic_write(tmp_path, "data/x-{token}.parquet") as file:
        file.write(b"hello")
        (temporary,) = (path for path in tmp_path.iterdir() if path.is_file())
        assert re.fullmatch(r"\.tmp-[0-9a-f]{12}-x\.part", temporary.name)
    (made,) = (tmp_path / "data").iterdir()
    assert re.fullmatch(r"x-[0-9a-f]{8}\.parquet", made.name)
    assert file.path == f"data/{made.name}"
    with atomic_write(tmp_path, "data/x-{token}.parquet") as file:
        file.write(b"hello")
    assert len(list((tmp_path / "data").iterdir())) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


@pytest.mark.parametrize("pieces", [[], [b""], [b"a"], [b"ab", b"c" * 100_000, b"d"]])
def test_size_and_hash_are_those_of_the_file(tmp_path, pieces):
    with atomic_write(tmp_path, "x") as file:
        for i, piece in enumerate(pieces):
            assert file.write(piece) == len(piece)
            assert file.tell() == sum(map(len, pieces[: i + 1]))
    data = (tmp_path / "x").read_bytes()
    assert data == b"".join(pieces)
    assert (file.size, file.sha256()) == (len(data), hashlib.sha256(data).hexdigest())


def test_a_small_file_comes_with_its_manifest_entry(tmp_path):
    digest = "2cf24dba5fb0a30e26e83b2ac5b9e29e1b161e5c1fa7425e73043362938b9824"
    assert write(tmp_path, "meta/x.json", b"hello") == FileEntry("meta/x.json", 5, digest)


def test_a_folder_that_is_not_there_is_not_made(tmp_path):
    with pytest.raises(FileNotFoundError):
        write(tmp_path / "missing", "data/x", b"data")
    assert list(tmp_path.iterdir()) == []
