"""CSV with a header, the columns of the dataset and one row per transition. The decimals identify every float
exactly. With a history, earlier observations follow in columns such as obs_velocity_lag_1. A view replaces
the observations by its frames, whose names are in the header. Compressed if `--out` ends in .gz. Written
in constant memory.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pyarrow as pa
from pyarrow import csv

from ibdata.dataset.history import stacked
from ibdata.dataset.transitions import Transitions, as_batch, transitions
from ibdata.exporters._tables import Rows
from ibdata.exporters._target import differs
from ibdata.exporters._view import View


def export(view: View, path: Path, target: Path) -> str:
    """Write the CSV file."""
    with pa.output_stream(path) as file, ExitStack() as stack:
        writer: csv.CSVWriter | None = None
        for table in _tables(view, "write"):
            writer = writer or stack.enter_context(csv.CSVWriter(file, table.schema))
            writer.write_table(table)
    return f"""\
from pyarrow import csv

text = csv.ConvertOptions(column_types={{"policy": "string"}})  # also where a label looks like a number
data = csv.read_csv({str(target)!r}, convert_options=text).to_pandas()
"""


def _tables(view: View, what: str) -> Iterator[pa.Table]:
    """All columns in a form that CSV can hold: labels as text instead of dictionary numbers."""
    columns = [column.name for column in view.dataset.info_model.columns]
    shown = {*view.frame, *view.group("observation"), *view.group("next_observation")}
    for table in view.tables(columns, what):
        made = transitions(table, view.dataset.info_model, view.options)
        out, rows = pa.Table.from_batches([as_batch(made, view.frame)]), table.take(made.rows)
        beside = [name for name in columns if name not in {*out.column_names, *shown}]
        for name, source in [*zip(beside, beside, strict=True), *((f"clean_{x}", x) for x in view.clean)]:
            column = rows[source]
            text = pa.types.is_dictionary(column.type)
            out = out.append_column(name, column.cast(pa.string()) if text else column)
        yield _with_history(view, out, made)


def _with_history(view: View, table: pa.Table, made: Transitions) -> pa.Table:
    """The table with columns for earlier frames, newest first."""
    if view.history == 1:
        return table
    histories = stacked(made.frames, made.next_frames, made.step, view.history)
    for prefix, history in zip(("", "next_"), histories, strict=True):
        for i in range(len(view.frame), history.shape[1]):
            lag, place = divmod(i, len(view.frame))
            table = table.append_column(f"{prefix}{view.frame[place]}_lag_{lag}", pa.array(history[:, i]))
    return table


def verify(view: View, path: Path) -> None:
    """Compare the file with the data."""
    found: Rows | None = None
    for expected in _tables(view, "check"):
        if found is None:
            options = csv.ConvertOptions(column_types=expected.schema, null_values=[])
            reader = csv.open_csv(path, convert_options=options)
            found = Rows(reader, reader.schema)
        if not _same(found.take(expected.num_rows), expected):
            raise differs(str(path))


def _same(a: pa.Table, b: pa.Table) -> bool:
    """Whether two tables hold the same values; NaN equals NaN."""
    return a.num_rows == b.num_rows and all(
        x.to_numpy().tobytes() == y.to_numpy().tobytes() if pa.types.is_floating(y.type) else x.equals(y)
        for x, y in zip(a.columns, b.columns, strict=True)
    )
