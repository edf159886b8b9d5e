"""Reading a stream of Arrow batches in pieces of any size."""

from __future__ import annotations

from collections.abc import Iterator

import pyarrow as pa


class Rows:
    """The rows of a stream of Arrow batches, in order."""

    def __init__(self, batches: Iterator[pa.RecordBatch], schema: pa.Schema) -> None:
        self._batches = batches
        self._rest: pa.Table = schema.empty_table()

    def take(self, count: int) -> pa.Table:
        """The next rows; fewer at the end."""
        while self._rest.num_rows < count and (batch := next(self._batches, None)) is not None:
            self._rest = pa.concat_tables([self._rest, pa.table(batch)])
        taken = self._rest.slice(0, count)
        self._rest = self._rest.slice(count)
        return taken
