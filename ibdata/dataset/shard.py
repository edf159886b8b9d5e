"""One shard: simulate, write, and say what was written."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow.parquet as pq

from ibdata.columns import Table, columns
from ibdata.dataset.digest import episode_digests
from ibdata.dataset.files import FileEntry, HashingFile, committed
from ibdata.dataset.schema import ROW_GROUP_ROWS, arrow_schema, arrow_table, digest_runs, writer_options
from ibdata.dataset.statistics import Floats, Moments, moments, sample_stride, sums
from ibdata.errors import IbdataError
from ibdata.experiment import Experiment
from ibdata.experiment.plan import Shard
from ibdata.rollout import Columns, rollout


class Written(NamedTuple):
    """What is known of a shard once it is on the disk."""

    shard: Shard
    entry: FileEntry
    digests: list[bytes]  # of the episodes
    returns: Floats  # of the episodes, undiscounted
    moments: Moments  # of the float columns
    sample: Table  # of the float columns, for quantiles
    clipped: int


def write_shard(experiment: Experiment, shard: Shard, folder: Path) -> Written:
    """Simulate a shard and commit it to its file."""
    floats = rollout(experiment, shard.first, shard.stop)
    with committed(folder, shard.file) as file:
        encode(experiment, shard, floats, file)
    return _written(experiment, shard, floats, FileEntry(shard.file, file.size, file.sha256()))


def encode(experiment: Experiment, shard: Shard, floats: Columns, file: HashingFile) -> None:
    """Write a shard as Parquet."""
    described = columns(experiment)
    with pq.ParquetWriter(file, arrow_schema(described), **writer_options(described)) as writer:
        writer.write_table(arrow_table(experiment, shard, floats), row_group_size=ROW_GROUP_ROWS)


def _written(experiment: Experiment, shard: Shard, floats: Columns, entry: FileEntry) -> Written:
    n = shard.stop - shard.first
    parts = moments(floats.table)
    if not np.isfinite(parts.squares[:-1]).all():
        bad = floats.names[int(np.argmin(np.isfinite(parts.squares)))]
        raise IbdataError(f"{shard.file}: {bad}: found a value that is not finite, expected finite numbers")
    stride = sample_stride(experiment.rows)
    offset = -(shard.first * experiment.steps) % stride
    return Written(
        shard,
        entry,
        episode_digests(digest_runs(experiment, shard, floats), [experiment.steps] * n),
        sums(floats.table[floats.names.index("reward")], experiment.steps),
        parts,
        np.ascontiguousarray(floats.table[:, offset::stride]),
        floats.clipped,
    )
