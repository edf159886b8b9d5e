"""Files that are written whole or not at all. tests/life and tests/faults do so at every operation."""

import os
from pathlib import Path

import pytest

from ibdata.system.files import file_sha256, plain_bytes, remove, write


@pytest.mark.parametrize(("module", "failing"), [(os, "fsync"), (Path, "replace")])
def test_the_old_file_stays_if_the_system_refuses(monkeypatch, tmp_path, module, failing):
    def refuse(*_):
        raise OSError(28, "No space left on device")

    (tmp_path / "x").write_bytes(b"old")
    monkeypatch.setattr(module, failing, refuse)
    with pytest.raises(OSError, match="No space"):
        write(tmp_path, "x", b"new")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("x", b"old")]


def test_a_link_is_replaced_or_removed_and_not_followed(tmp_path):
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept/file").write_bytes(b"mine")
    for link, to in {"x": "kept/file", "dangling": "none", "folder": "kept"}.items():
        (tmp_path / link).symlink_to(to)
    for name in ("x", "dangling"):
        write(tmp_path, name, b"data")
        assert not (tmp_path / name).is_symlink()
        remove(tmp_path / name)
    remove(tmp_path / "folder")
    remove(tmp_path / "missing")
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]
    assert (tmp_path / "kept/file").read_bytes() == b"mine"


def test_only_regular_files_of_a_size_are_read(tmp_path):
    """A pipe would never end."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "large").write_bytes(b"12345")
    (tmp_path / "link").symlink_to("large")
    for name in ("pipe", "folder", "large", "missing"):
        with pytest.raises(OSError, match=r"regular file|larger than 4|directory"):
            plain_bytes(tmp_path / name, 4)
    assert plain_bytes(tmp_path / "link", 5) == b"12345"
    assert [file_sha256(tmp_path / name) for name in ("pipe", "folder", "missing")] == [None] * 3
