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

from ibdata.dataset.transitions import as_batch, stacked, transitions
from ibdata.exporters._source import Source

OBSERVED = ("observation", "next_observation")  # roles of columns for which there are frames
HOLDS_COSTS = True  # it has a place for them


def export(source: Source, path: Path, target: Path) -> str:
    """Write the CSV file."""
    tables = _tables(source)
    first = next(tables)
    with pa.output_stream(path) as file, csv.CSVWriter(file, first.schema) as writer:
        for table in chain([first], tables):
            writer.write_table(table)
    return f"""\
from pyarrow import csv

text = csv.ConvertOptions(column_types={{"policy": "string"}})  # also where a label looks like a number
data = csv.read_csv({str(target)!r}, convert_options=text).to_pandas()
"""


def _tables(source: Source) -> Iterator[pa.Table]:
    """The transitions, the columns beside them, the clean values, and the histories."""
    columns = [column.name for column in source.info.columns]
    observed = [column.name for column in source.info.columns if column.role in OBSERVED]
    for table in source.tables(columns):
        block = transitions(table, source.info, source.options)
        rows = table.take(block.rows)
        out = pa.Table.from_batches([as_batch(block, source.frame)])
        for name in columns:
            if name not in observed and name not in out.column_names:
                is_label = pa.types.is_dictionary(rows[name].type)  # which CSV does not have
                out = out.append_column(name, rows[name].cast(pa.string()) if is_label else rows[name])
        for name in source.clean:
            out = out.append_column(f"clean_{name}", rows[name])
        histories = stacked(block.frames, block.next_frames, block.step, source.history)  # newest first
        for prefix, history in zip(("", "next_"), histories, strict=True):
            for i in range(len(source.frame), history.shape[1]):
                lag, number = divmod(i, len(source.frame))
                name = f"{prefix}{source.frame[number]}_lag_{lag}"
                out = out.append_column(name, pa.array(history[:, i]))
        yield out
