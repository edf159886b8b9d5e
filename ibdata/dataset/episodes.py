"""Reading meta/episodes.parquet, the table of episodes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from ibdata.dataset import manifest, parquet
from ibdata.dataset.models import Manifest
from ibdata.system.storage import damaged

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


def read_episodes(place: Any, listed: Manifest) -> pa.Table:
    """Read the table of episodes. Raises DatasetError if it is damaged or does not match the manifest."""
    data = manifest.listed_content(place, listed, PATH)
    rows = max(shard.episodes[1] for shard in listed.shards)
    table = parquet.read(place, PATH, rows=rows, data=data)
    for name in SCHEMA.names:
        found = table.schema.field(name).type if name in table.column_names else "none"
        if found != SCHEMA.field(name).type:
            raise damaged(place, PATH, f"{name}: found {found}, expected {SCHEMA.field(name).type}")
        if table[name].null_count:
            raise damaged(place, PATH, f"{name}: found no value in some rows, expected one in each")
    if problem := _wrong_place(table, len(listed.shards)):
        raise damaged(place, PATH, problem)
    return table.select(SCHEMA.names)


def _wrong_place(table: pa.Table, shards: int) -> str | None:
    """Describe the first episode that leaves a gap in the rows of its shard; None if there is none."""
    shard, length = table["shard"].to_numpy(), table["length"].to_numpy()
    total = np.cumsum(length) - length
    firsts = np.r_[True, shard[1:] != shard[:-1]]
    start = total - np.maximum.accumulate(np.where(firsts, total, 0))
    rules = {
        "episode": table["episode"].to_numpy() == np.arange(len(table)),
        "length": length > 0,
        "shard": (shard >= 0) & (shard < shards) & np.r_[True, shard[1:] >= shard[:-1]],
        "row_start": table["row_start"].to_numpy() == start,
        "row_stop": table["row_stop"].to_numpy() == start + length,
    }
    for name, holds in rules.items():
        if not holds.all():
            row = int(np.argmin(holds))
            return f"row {row}: {name}: found {table[name][row].as_py()}, expected episodes without gaps"
    return None
