"""Damaged datasets give an error of one line that names the file, and never wrong data; see tests/corpus."""

import json
import re

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.refusals import refused

import ibdata
from ibdata.errors import DatasetError


def test_an_edited_manifest_or_one_of_another_version_is_refused(copied):
    path = copied / "meta/manifest.json"
    listed = json.loads(path.read_text())
    for key, value, line in (
        *(
            (key, listed[key][:-1], "does not fit its checksum")
            for key in ("shards", "files", "content_root")
        ),
        ("version", listed["version"] + 1, "found version .*; update ibdata"),
        ("data_version", listed["data_version"] - 1, "found data version .*; make"),
    ):
        path.write_text(json.dumps({**listed, key: value}))
        refused(rf"meta/manifest\.json: .*{line}", ibdata.open, copied, error=DatasetError)


READS = [
    lambda d: d.table(["reward", "obs_consumption"]),
    lambda d: list(d.iter_batches(["obs_consumption"])),
    lambda d: d.arrays(),
]
FOREIGN = {
    "other columns": lambda table: pa.table({"a": range(len(table))}),
    "texts": lambda table: pa.table({name: ["x"] * len(table) for name in table.column_names}),
    "lists": lambda table: pa.table({name: [[1]] * len(table) for name in table.column_names}),
    "wider numbers": lambda table: table.cast(
        pa.schema([(f.name, pa.float64() if f.type == pa.float32() else f.type) for f in table.schema])
    ),
}


@pytest.mark.parametrize("change", FOREIGN.values(), ids=FOREIGN)
def test_a_foreign_file_in_place_of_a_shard_is_one_line(copied, shard_file, change):
    shard = shard_file(copied, 3)
    pq.write_table(change(pq.read_table(copied / shard)), copied / shard)
    for read in READS:
        said = refused(rf"{re.escape(shard)}: \w+: .*expected", read, ibdata.open(copied), error=DatasetError)
        assert len(said) < 300
