"""CSV with a header, the columns of the dataset and one row per transition. The decimals identify every float
exactly. With a history, earlier observations follow in columns such as obs_velocity_lag_1. Compressed if
`--out` ends in .gz. Written in constant memory.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import csv

from ibdata.dataset.history import stacked
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
    for table in view.tables([column.name for column in view.dataset.info_model.columns], what):
        for i, field in enumerate(table.schema):
            if pa.types.is_dictionary(field.type):
                table = table.set_column(i, field.name, table[field.name].cast(pa.string()))
        yield _with_history(view, table)


def _with_history(view: View, table: pa.Table) -> pa.Table:
    """The table with columns for earlier observations, newest first."""
    if view.history == 1:
        return table
    names = [view.group("observation"), view.group("next_observation")]
    now, after = (np.stack([table[name].to_numpy() for name in group], axis=1) for group in names)
    histories = stacked(now, after, table["step"].to_numpy(), view.history)
    for group, history in zip(names, histories, strict=True):
        for i in range(len(group), history.shape[1]):
            lag, place = divmod(i, len(group))
            table = table.append_column(f"{group[place]}_lag_{lag}", pa.array(history[:, i]))
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
