"""Read stored rows in the parts in which they were simulated, so that memory is bounded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from ibdata.errors import DatasetError
from ibdata.experiment.columns import layout
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.experiment.rollout import Columns, parts

BATCH_ROWS = 65_536


class Part(NamedTuple):
    """Stored rows of whole episodes of a shard."""

    episodes: Shard
    floats: Columns
    others: list[pa.RecordBatch]  # the other columns; all columns of batches in which a value is missing


def stored_parts(
    spec: DatasetSpec, shard: Shard, batches: Iterable[pa.RecordBatch], most: int | None = None
) -> Iterator[Part]:
    """Cut the rows of a shard into parts.

    Args:
        spec: The experiments and splits of the dataset.
        shard: The shard.
        batches: All its rows, in order. None is kept after it was copied.
        most: At most so many rows a part, but at least an episode; by default the parts are those in which
            the shard was simulated, on which the last bits of its statistics depend.

    Raises:
        DatasetError: There are fewer rows than the shard has.
    """
    experiment, source = spec.of_shard(shard), iter(batches)
    names, rest = layout(experiment).names, pa.record_batch({})
    if most is None:
        cuts = parts(experiment, shard.first, shard.stop)
    else:
        count = max(1, most // experiment.steps)
        cuts = ((i, min(shard.stop, i + count)) for i in range(shard.first, shard.stop, count))
    for first, stop in cuts:
        rows, others = (stop - first) * experiment.steps, list[pa.RecordBatch]()
        table = np.empty((len(names), rows), dtype=experiment.output.dtype)
        row = 0
        while row < rows:
            if not rest.num_rows:
                batch = next(source, None)
                if batch is None:
                    raise DatasetError(f"{shard.stem}: found fewer rows than listed; see ibdata validate")
                rest = batch
            own, rest = rest.slice(0, rows - row), rest.slice(rows - row)
            for out, name in zip(table, names, strict=True):
                out[row : row + own.num_rows] = own[name].to_numpy(zero_copy_only=False)
            whole = not any(column.null_count for column in own.columns)
            others.append(own.drop_columns(list(names)) if whole else own)
            row += own.num_rows
        yield Part(shard._replace(first=first, stop=stop), Columns(names, table, 0), others)
