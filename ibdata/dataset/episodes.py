"""Reading meta/episodes.parquet, the table of episodes."""

from __future__ import annotations

from typing import Any

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
        ("acting", pa.dictionary(pa.int32(), pa.string())),  # of a mixture, the policy drawn for the episode
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
    table = parquet.read(place, PATH, SCHEMA.names, rows=listed.shards[-1].episodes[1], data=data)
    if not table.schema.equals(SCHEMA) or any(column.null_count for column in table.columns):
        raise damaged(place, PATH, "found other columns than ibdata writes; see ibdata validate")
    return table
