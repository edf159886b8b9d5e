"""meta/episodes.parquet: a row an episode."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa

from ibdata.dataset import manifest, parquet
from ibdata.errors import DatasetError

PATH = "meta/episodes.parquet"
SCHEMA = pa.schema(
    [
        ("episode", pa.int64()),
        ("cell", pa.dictionary(pa.int32(), pa.string())),
        ("index", pa.int64()),
        ("setpoint", pa.float64()),
        ("policy", pa.dictionary(pa.int32(), pa.string())),
        ("splits", pa.list_(pa.string())),
        ("length", pa.int64()),
        ("return", pa.float64()),
        ("shard", pa.int32()),
        ("row_start", pa.int64()),
        ("row_stop", pa.int64()),
        ("digest", pa.binary(32)),
    ]
)


def read_episodes(folder: Path, names: Sequence[str] | None = None) -> pa.Table:
    """The table of episodes, or some of its columns; DatasetError where it is not what it should be."""
    path = manifest.locate(folder, PATH)
    table = parquet.read(path, names)
    wanted = SCHEMA.names if names is None else list(names)
    for name in wanted:
        if name not in table.column_names or table.schema.field(name).type != SCHEMA.field(name).type:
            found = table.schema.field(name).type if name in table.column_names else "none"
            raise DatasetError(f"{path}: {name}: found {found}, expected {SCHEMA.field(name).type}")
        if table[name].null_count:
            raise DatasetError(f"{path}: {name}: found no value in some rows, expected one in each")
    return table.select(wanted)
