"""ibdata head."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._shared import folder_argument, json_option, print_json


@click.command("head")
@folder_argument
@click.option("--rows", "-n", type=click.IntRange(min=1), default=5, show_default=True, help="How many rows.")
@click.option("--columns", metavar="A,B,…", help="Only these columns.")
@click.option("--split", metavar="NAME", help="Only rows of this split.")
@json_option
def command(folder: Path, rows: int, columns: str | None, split: str | None, as_json: bool) -> None:
    """Print the first rows, a column a line.

    \b
    ibdata head data/random -n 3 --columns step,act_velocity,reward
    """
    from ibdata.dataset.reader import Dataset

    names = columns.split(",") if columns else None
    batch = next(Dataset(folder).iter_batches(names, split, batch_rows=rows))
    if as_json:
        print_json({"rows": batch.to_pylist()})
        return
    values = {name: batch.column(name).to_pylist() for name in batch.schema.names}
    width = max(map(len, values))
    for name, column in values.items():
        shown = (f"{x:.6g}" if isinstance(x, float) else str(x) for x in column)
        click.echo(f"{name.ljust(width)} {''.join(x.rjust(12) for x in shown)}")
