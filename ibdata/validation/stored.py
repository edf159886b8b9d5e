"""Read stored rows in the parts in which they were simulated, so that memory is bounded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa

from ibdata.dataset import parquet
from ibdata.errors import DatasetError
from ibdata.experiment import Experiment
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.simulation.rollout import Columns, parts
from ibdata.simulation.variables import layout
from ibdata.writing.summary import ShardSummary, describe

BATCH_ROWS = 65_536


def stored_parts(
    spec: DatasetSpec, shard: Shard, batches: Iterable[pa.RecordBatch]
) -> Iterator[tuple[Shard, pa.Table]]:
    """Cut the rows of a shard into the parts in which they were simulated.

    Args:
        spec: The experiments and splits of the dataset.
        shard: The shard.
        batches: All its rows, in order.

    Raises:
        DatasetError: There are fewer rows than the shard has.
    """
    steps, source = spec.of_shard(shard).steps, iter(batches)
    waiting: list[pa.RecordBatch] = []
    for first, stop in parts(spec.of_shard(shard), shard.first, shard.stop):
        rows = (stop - first) * steps
        while sum(batch.num_rows for batch in waiting) < rows:
            batch = next(source, None)
            if batch is None:
                raise DatasetError(f"{shard.stem}: found fewer rows than listed; see ibdata validate")
            waiting.append(batch)
        table = pa.Table.from_batches(waiting)
        yield shard._replace(first=first, stop=stop), table.slice(0, rows)
        waiting = table.slice(rows).to_batches()


def float_columns(experiment: Experiment, table: pa.Table) -> Columns:
    """The float columns of a table, in the form that a rollout returns."""
    names = layout(experiment).names
    values = np.empty((len(names), table.num_rows), dtype=experiment.output.dtype)
    for out, name in zip(values, names, strict=True):
        row = 0
        for chunk in table[name].chunks:
            out[row : row + len(chunk)] = chunk.to_numpy(zero_copy_only=False)
            row += len(chunk)
    return Columns(names, values, 0)


def stored_content(spec: DatasetSpec, shard: Shard, path: Path) -> ShardSummary:
    """Summarize the rows of a shard's file. Raises DatasetError if it cannot be read as that shard."""
    experiment = spec.of_shard(shard)
    rows = (shard.stop - shard.first) * experiment.steps
    batches = parquet.batches(path, layout(experiment).names, BATCH_ROWS, rows)
    made = ((part, float_columns(experiment, table)) for part, table in stored_parts(spec, shard, batches))
    return describe(spec, shard, made)
