"""Files that other users may have written, or that are damaged, are not read."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

import pytest

from ibdata.system import private_files
from ibdata.system.private_files import make, opened, resolved, verified, write

CONTENT = bytes(range(256))


@pytest.fixture
def folder(tmp_path):
    """A folder with one good file."""
    made = tmp_path / "code"
    make(str(made))
    write(str(made), "file", CONTENT)
    return made


@pytest.fixture
def give_away(monkeypatch):
    """Make a path another user's: root can, and to others their own things become another's."""

    def give(path):
        if os.geteuid() == 0:
            os.chown(path, 12345, -1, follow_symlinks=False)
        else:
            monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)

    return give


def read(folder: Path, name: str = "file") -> bytes:
    with verified(str(folder), name) as descriptor:
        return os.read(descriptor, 10_000)


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_what_was_written_is_read(folder):
    assert read(folder) == CONTENT
    write(str(folder), "file", b"other")
    assert read(folder) == b"other"
    assert [path.name for path in folder.iterdir()] == ["file"]


@pytest.mark.parametrize("mask", [0o000, 0o077])
def test_folders_and_files_are_this_users_alone_whatever_the_umask(tmp_path, mask):
    before = os.umask(mask)
    try:
        make(str(tmp_path / "a" / "b"))
        write(str(tmp_path / "a" / "b"), "file", CONTENT)
    finally:
        os.umask(before)
    assert [mode(tmp_path / path) for path in ("a", "a/b", "a/b/file")] == [0o700, 0o700, 0o600]


@pytest.mark.parametrize("bit", [stat.S_IWGRP, stat.S_IWOTH])
def test_a_folder_that_others_can_write_to_is_refused(folder, bit):
    folder.chmod(0o700 | bit)
    with pytest.raises(PermissionError, match="other users can write"):
        read(folder)
    with pytest.raises(PermissionError, match="other users can write"):
        write(str(folder), "more", CONTENT)
    assert [path.name for path in folder.iterdir()] == ["file"]


@pytest.mark.parametrize("bit", [stat.S_IWGRP, stat.S_IWOTH])
def test_a_file_that_others_can_write_to_is_refused_and_can_be_replaced(folder, bit):
    (folder / "file").chmod(0o600 | bit)
    with pytest.raises(PermissionError, match="other users can write"):
        read(folder)
    write(str(folder), "file", CONTENT)
    assert read(folder) == CONTENT


def test_a_folder_that_can_be_read_only_is_read(folder):
    (folder / "file").chmod(0o444)
    folder.chmod(0o555)
    assert read(folder) == CONTENT


def test_a_folder_of_another_user_is_refused(folder, give_away):
    give_away(folder)
    with pytest.raises(PermissionError, match="belongs to another user"), opened(str(folder)):
        pass


def test_a_file_of_another_user_is_refused(folder, give_away):
    give_away(folder / "file")
    with pytest.raises(PermissionError, match="belongs to another user"):
        read(folder)


def test_links_are_not_followed(folder, tmp_path):
    (tmp_path / "link").symlink_to(folder)
    with pytest.raises(OSError, match=os.strerror(errno.ENOTDIR)):
        read(tmp_path / "link")
    (folder / "link").symlink_to("file")
    with pytest.raises(OSError, match=os.strerror(errno.ELOOP)):
        read(folder, "link")


def test_a_link_of_ones_own_leads_to_a_folder_and_another_users_does_not(folder, tmp_path, give_away):
    link = tmp_path / "link"
    link.symlink_to(folder)
    assert resolved(str(link)) == str(folder.resolve())
    give_away(link)
    with pytest.raises(PermissionError, match="belongs to another user"):
        resolved(str(link))


def test_what_is_no_file_is_refused_at_once(folder):
    os.mkfifo(folder / "fifo")
    (folder / "folder").mkdir()
    for name in ("fifo", "folder"):
        with pytest.raises(OSError, match="damaged"):
            read(folder, name)


@pytest.mark.parametrize("length", [0, 1, 31, 32, 33, 287])
def test_a_file_that_was_cut_off_is_refused(folder, length):
    os.truncate(folder / "file", length)
    with pytest.raises(OSError, match="damaged"):
        read(folder)


def test_a_flipped_bit_anywhere_is_noticed(folder):
    good = (folder / "file").read_bytes()
    for place in range(len(good)):
        bad = bytearray(good)
        bad[place] ^= 1 << place % 8
        (folder / "file").write_bytes(bad)
        with pytest.raises(OSError, match="damaged"):
            read(folder)


def test_a_write_that_fails_leaves_the_file_that_was_there(folder, monkeypatch):
    def refuse(*args, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(private_files.os, "replace", refuse)
    with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
        write(str(folder), "file", b"other")
    assert [path.name for path in folder.iterdir()] == ["file"]
    assert read(folder) == CONTENT
