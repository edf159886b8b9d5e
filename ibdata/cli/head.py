"""ibdata head."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ibdata.cli._completion import columns as column_names
from ibdata.cli._completion import splits as split_names
from ibdata.cli._shared import json_option, place_argument, print_json, say
from ibdata.errors import DatasetError

if TYPE_CHECKING:
    import pyarrow as pa

MAX_ROWS = 1_000_000


@click.command("head")
@place_argument
@click.option(
    "--rows", "-n", type=click.IntRange(1, MAX_ROWS), default=5, show_default=True, help="Number of rows."
)
@click.option("--columns", metavar="A,B,…", shell_complete=column_names, help="Print only these columns.")
@click.option("--split", metavar="NAME", shell_complete=split_names, help="Print only rows of this split.")
@json_option
def command(folder: Path | str, rows: int, columns: str | None, split: str | None, as_json: bool) -> None:
    """Print the first rows of a dataset, one column per line.

    \b
    ibdata head data/random -n 3 --columns step,act_velocity,reward
    """
    from ibdata.dataset.reader import Dataset

    names = None if columns is None else [name.strip() for name in columns.split(",")]
    table = _first(Dataset(folder).iter_batches(names, split, batch_rows=rows), rows)
    if table is None:
        raise DatasetError(f"{folder}: found no rows; see ibdata validate {folder}")
    if as_json:
        print_json({"rows": [_plain(row) for row in table.to_pylist()]})
        return
    values = {name: table.column(name).to_pylist() for name in table.schema.names}
    width = max(map(len, values))
    for name, column in values.items():
        shown = (f"{x:.6g}" if isinstance(x, float) else str(x) for x in column)
        say(f"{name.ljust(width)} {''.join(x.rjust(12) for x in shown)}")


def _first(batches: Iterable[pa.RecordBatch], count: int) -> pa.Table | None:
    """The first rows of batches, which end with a file; None if there are none."""
    import pyarrow as pa

    kept, missing = [], count
    for batch in batches:
        kept.append(batch.slice(0, missing))
        missing -= kept[-1].num_rows
        if missing == 0:
            break
    return pa.Table.from_batches(kept) if kept else None


def _plain(row: Mapping[str, Any]) -> Mapping[str, Any]:
    """A row as JSON can hold it: null in place of NaN and infinities."""
    return {k: None if isinstance(x, float) and not math.isfinite(x) else x for k, x in row.items()}
