"""Parquet for RLlib's offline algorithms. `--out` is a file if it ends in .parquet, else a folder that gets
arrays.parquet. Observations are fixed-size lists, because RLlib needs one vector per row. next_observation is
included, because RLlib makes an episode of each row. There is no text column, because training would fail on
it. The command prints the configuration that RLlib needs. Written in constant memory.
"""

from __future__ import annotations

import json
from itertools import chain
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from ibdata._numerics.arrays import Arrays
from ibdata.exporters._source import PARQUET, Source, vectors

ROW_GROUP_ROWS = 100_000
SUFFIX = ".parquet"
FILE = "arrays.parquet"
SCHEMA = {
    "eps_id": "episode",
    "t": "step",
    "obs": "observation",
    "actions": "action",
    "rewards": "reward",
    "new_obs": "next_observation",
    "terminateds": "terminated",
    "truncateds": "truncated",
}


def export(source: Source, path: Path, target: Path) -> str:
    """Write the Parquet file."""
    if path.suffix != SUFFIX:
        path.mkdir()
        path, target = path / FILE, target / FILE
    source.refuse_no_rows()
    metadata = {"view": json.dumps(source.plain())}
    tables = (_table(block).replace_schema_metadata(metadata) for block in source.blocks())
    first = next(tables)
    with pq.ParquetWriter(path, first.schema, **PARQUET) as writer:
        for table in chain([first], tables):
            writer.write_table(table, row_group_size=ROW_GROUP_ROWS)
    return f"""\
schema = {{
{"".join(f"    {key!r}: {column!r},{chr(10)}" for key, column in SCHEMA.items())}}}
config = config.offline_data(
    input_=[{str(target.absolute())!r}],  # a list, because RLlib takes a string for a path, and breaks URLs
    input_read_schema=schema,
    input_read_method_kwargs={{"columns": list(schema.values())}},
    dataset_num_iters_per_learner=3,
    map_batches_kwargs={{"concurrency": 1, "num_cpus": 1}},
)  # no input_read_batch_size: it is for episodes only
"""


def _table(block: Arrays) -> pa.Table:
    """The columns of SCHEMA."""
    return pa.table(
        {
            "episode": block["episode"],
            "step": block["step"],
            "observation": vectors(block["observations"]),
            "action": vectors(block["actions"]),
            "reward": block["rewards"],
            "next_observation": vectors(block["next_observations"]),
            "terminated": block["terminated"],
            "truncated": block["truncated"],
        }
    )
