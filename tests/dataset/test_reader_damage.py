"""Damaged datasets give an error of one line that names the file, and never wrong data."""

from __future__ import annotations

import hashlib
import json
import re

import pyarrow.parquet as pq
import pytest

import ibdata
from ibdata.errors import DatasetError

AGAIN = "make the dataset again with this ibdata"


def sealed(folder, change):
    """Change the manifest as someone would who can compute its checksum."""
    path = folder / "meta/manifest.json"
    manifest = json.loads(path.read_text())
    change(manifest)
    manifest.pop("checksum")
    manifest["checksum"] = hashlib.sha256(json.dumps(manifest, sort_keys=True).encode()).hexdigest()
    path.write_text(json.dumps(manifest))


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"", "found no valid JSON"),
        (b"{", "found no valid JSON"),
        (b"\xff\xfe{}", "found no valid JSON"),
        (b"[" * 200_000, "found no valid JSON"),
        (b"[]", "found another format, expected ibdata-manifest"),
        (b"null", "found another format, expected ibdata-manifest"),
        (b"{}", "found another format, expected ibdata-manifest"),
        (b'{"format": "ibdata-dataset", "version": 1}', "found another format, expected ibdata-manifest"),
        (b'{"format": "ibdata-manifest", "version": 2}', f"found version 2, expected 1; {AGAIN}"),
        (b'{"format": "ibdata-manifest", "version": 1}', f"found data version None, expected 3; {AGAIN}"),
        (
            b'{"format": "ibdata-manifest", "version": 1, "data_version": 1}',
            f"found data version 1, expected 3; {AGAIN}",
        ),
        (b'{"format": "ibdata-manifest", "version": 1, "data_version": 3}', "does not fit its checksum"),
    ],
    ids=[
        *("empty", "cut", "no text", "deep", "list", "null", "bare", "other format"),
        *("other version", "no data version", "other data version", "no checksum"),
    ],
)
def test_a_manifest_that_is_none_is_an_error_of_one_line(copied, content, line):
    (copied / "meta/manifest.json").write_bytes(content)
    with pytest.raises(DatasetError) as error:
        ibdata.open(copied)
    assert str(error.value).startswith(f"{copied / 'meta/manifest.json'}: ")
    assert line in str(error.value)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400
    assert error.value.exit_code == 3


def test_a_changed_manifest_does_not_fit_its_checksum(copied):
    path = copied / "meta/manifest.json"
    path.write_text(path.read_text().replace('"rows": 480', '"rows": 481'))
    with pytest.raises(DatasetError, match="does not fit its checksum; the file has been changed"):
        ibdata.open(copied)


@pytest.mark.parametrize("kind", ["files", "shards"])
@pytest.mark.parametrize(
    "path", ["../secret", "data/../../secret", "/secret", "data/a/b.parquet", "data/", ""]
)
def test_a_path_out_of_the_folder_is_an_error(copied, kind, path):
    sealed(copied, lambda manifest: manifest[kind][0].update(path=path))
    with pytest.raises(DatasetError, match=f"path: found '{path}', expected a path in data"):
        ibdata.open(copied)


@pytest.mark.parametrize("kind", ["missing", "folder", "file", "unfinished"])
def test_a_folder_without_a_finished_dataset_is_an_error(copied, tmp_path, kind):
    folder = {"missing": tmp_path / "nothing", "file": copied / "README.md"}.get(kind, copied)
    if kind in ("folder", "unfinished"):
        (copied / "meta/manifest.json").unlink()
    if kind == "folder":
        (copied / "meta/manifest.json").mkdir()
    with pytest.raises(DatasetError) as error:
        ibdata.open(folder)
    assert str(error.value).startswith(str(folder))
    assert "\n" not in str(error.value)


READS = [
    lambda d: d.table(["reward", "obs_consumption"]),
    lambda d: list(d.iter_batches(["obs_consumption"])),
    lambda d: d.to_pandas(),
    lambda d: d.arrays(),
]
reads = pytest.mark.parametrize("read", READS, ids=["table", "batches", "pandas", "arrays"])


@pytest.mark.parametrize("damage", ["missing", "cut"])
@reads
def test_a_shard_that_is_not_whole_is_an_error_that_names_it(copied, shard_file, damage, read):
    shard = shard_file(copied, 3)
    path = copied / shard
    whole = path.read_bytes()
    path.unlink()
    if damage == "cut":
        path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DatasetError, match=f"{re.escape(shard)}: "):
        read(ibdata.open(copied))


@reads
def test_a_flipped_bit_is_an_error_and_never_other_data(copied, shard_file, read):
    shard = shard_file(copied, 3)
    path = copied / shard
    whole = path.read_bytes()
    column = pq.ParquetFile(path).metadata.row_group(0).column(7)
    assert column.path_in_schema == "obs_consumption"
    end = column.data_page_offset + column.total_compressed_size
    for position in range(end - 80, end, 8):
        path.write_bytes(whole[:position] + bytes([whole[position] ^ 1]) + whole[position + 1 :])
        with pytest.raises(DatasetError, match=f"{re.escape(shard)}: "):
            read(ibdata.open(copied))


@pytest.mark.parametrize("name", ["dataset.json", "statistics.json", "episodes.parquet"])
@pytest.mark.parametrize("damage", ["missing", "empty"])
def test_damaged_metadata_are_an_error_that_names_the_file(copied, name, damage):
    path = copied / "meta" / name
    path.unlink()
    if damage == "empty":
        path.write_bytes(b"")
    dataset = ibdata.open(copied)
    calls = {
        "dataset.json": repr,
        "statistics.json": lambda d: d.statistics(),
        "episodes.parquet": lambda d: d.episodes,
    }
    found = {"missing": "missing", "empty": "found other content than the manifest lists"}[damage]
    with pytest.raises(DatasetError) as error:
        calls[name](dataset)
    assert str(error.value) == f"{path}: {found}; run ibdata repair {copied}"
