"""CSV with a header, the columns of the dataset and one row per transition. The decimals identify every float
exactly. With a history, earlier observations follow in columns such as obs_velocity_lag_1. A view replaces
the observations by its frames, whose names are in the header. Compressed if `--out` ends in .gz. Written
in constant memory.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pyarrow as pa
from pyarrow import csv

from ibdata.dataset.transitions import Transitions, as_batch, stacked, transitions
from ibdata.exporters._view import View

OBSERVED = ("observation", "next_observation")  # roles of columns for which there are frames
COSTS = True  # it has a place for them


def export(view: View, path: Path, target: Path) -> str:
    """Write the CSV file."""
    tables = _tables(view)
    first = next(tables)
    with pa.output_stream(path) as file, csv.CSVWriter(file, first.schema) as writer:
        for table in chain([first], tables):
            writer.write_table(table)
    return f"""\
from pyarrow import csv

text = csv.ConvertOptions(column_types={{"policy": "string"}})  # also where a label looks like a number
data = csv.read_csv({str(target)!r}, convert_options=text).to_pandas()
"""


def _tables(view: View) -> Iterator[pa.Table]:
    """The transitions, the columns beside them, the clean values, and the histories."""
    columns = [column.name for column in view.info.columns]
    observed = [column.name for column in view.info.columns if column.role in OBSERVED]
    for table in view.tables(columns):
        block = transitions(table, view.info, view.options)
        rows = table.take(block.rows)
        out = pa.Table.from_batches([as_batch(block, view.frame)])
        for name in columns:
            if name not in observed and name not in out.column_names:
                out = out.append_column(name, _without_dictionary(rows[name]))
        for name in view.clean:
            out = out.append_column(f"clean_{name}", rows[name])
        yield _with_history(view, out, block)


def _without_dictionary(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """Labels as text, because CSV has no dictionaries."""
    return column.cast(pa.string()) if pa.types.is_dictionary(column.type) else column


def _with_history(view: View, table: pa.Table, block: Transitions) -> pa.Table:
    """The table with columns for earlier frames, newest first."""
    if view.history == 1:
        return table
    histories = stacked(block.frames, block.next_frames, block.step, view.history)
    for prefix, history in zip(("", "next_"), histories, strict=True):
        for i in range(len(view.frame), history.shape[1]):
            lag, place = divmod(i, len(view.frame))
            table = table.append_column(f"{prefix}{view.frame[place]}_lag_{lag}", pa.array(history[:, i]))
    return table
