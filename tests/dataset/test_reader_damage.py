"""Damaged datasets give an error of one line that names the file, and never wrong data.

tests/corpus holds many more such manifests and files of metadata.
"""

import json
import re

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import ibdata
from ibdata.errors import DatasetError


@pytest.mark.parametrize("key", ["shards", "files", "content_root"])
def test_an_edited_manifest_is_refused(copied, key):
    path = copied / "meta/manifest.json"
    listed = json.loads(path.read_text())
    listed[key] = listed[key][:-1]
    path.write_text(json.dumps(listed))
    with pytest.raises(DatasetError, match=r"meta/manifest\.json: .*does not fit its checksum"):
        ibdata.open(copied)


READS = {
    "table": lambda d: d.table(["reward", "obs_consumption"]),
    "batches": lambda d: list(d.iter_batches(["obs_consumption"])),
    "pandas": lambda d: d.to_pandas(),
    "arrays": lambda d: d.arrays(),
}
reads = pytest.mark.parametrize("read", READS.values(), ids=READS)


METADATA = {
    "dataset.json": lambda d: d.info,
    "statistics.json": lambda d: d.statistics(),
    "episodes.parquet": lambda d: d.episodes,
}


@pytest.mark.parametrize(("name", "read"), METADATA.items(), ids=METADATA)
def test_damaged_metadata_are_named(copied, name, read):
    path = copied / "meta" / name
    path.write_bytes(b"")
    for found in ("found other content than the manifest lists", "missing"):
        with pytest.raises(DatasetError) as error:
            read(ibdata.open(copied))
        assert str(error.value) == f"{path}: {found}; run ibdata repair {copied}"
        path.unlink(missing_ok=True)


FOREIGN = {
    "other columns": lambda table: pa.table({"a": range(len(table))}),
    "texts": lambda table: pa.table({name: ["x"] * len(table) for name in table.column_names}),
    "lists": lambda table: pa.table({name: [[1]] * len(table) for name in table.column_names}),
    "wider numbers": lambda table: table.cast(
        pa.schema([(f.name, pa.float64() if f.type == pa.float32() else f.type) for f in table.schema])
    ),
}


@pytest.mark.parametrize("change", FOREIGN.values(), ids=FOREIGN)
@reads
def test_a_foreign_file_in_place_of_a_shard_is_one_line(copied, shard_file, change, read):
    shard = shard_file(copied, 3)
    pq.write_table(change(pq.read_table(copied / shard)), copied / shard)
    with pytest.raises(DatasetError, match=rf"{re.escape(shard)}: \w+: .*expected") as error:
        read(ibdata.open(copied))
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 300


@pytest.mark.parametrize(
    ("key", "by", "todo"), [("version", 1, "update ibdata"), ("data_version", -1, "make")]
)
def test_another_version_says_what_to_do(copied, key, by, todo):
    path = copied / "meta/manifest.json"
    listed = json.loads(path.read_text())
    path.write_text(json.dumps({**listed, key: listed[key] + by}))
    with pytest.raises(DatasetError, match=f"found {key.replace('_', ' ')} .*; {todo}"):
        ibdata.open(copied)
