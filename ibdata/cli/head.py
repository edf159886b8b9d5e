from pathlib import Path

import click

from ibdata.cli._options import place_argument, split_option
from ibdata.cli._printing import Printed, lines, prints_result
from ibdata.dataset.tabular import column_texts

MAX_ROWS = 1_000_000


@click.command("head")
@place_argument
@click.option(
    "--rows", "-n", type=click.IntRange(1, MAX_ROWS), default=5, show_default=True, help="Number of rows."
)
@click.option("--columns", metavar="A,B,…", help="Print only these columns.")
@split_option
@click.option(
    "--at", nargs=2, type=int, metavar="EPISODE STEP", help="Begin at this row; by default at the first."
)
@prints_result
def command(
    folder: Path | str, rows: int, columns: str | None, split: str | None, at: tuple[int, int] | None
) -> Printed:
    """Print the first rows of a dataset, or those from --at on, one column per line.

    \b
    ibdata head data/random -n 3 --columns step,act_velocity,reward
    ibdata head data/random --at 7 250
    """
    from ibdata.dataset.reader import Dataset

    names = None if columns is None else [name.strip() for name in columns.split(",")]
    first = Dataset(folder).head(rows, names, split, at=at)
    texts = {name: column_texts(first.column(name).to_pylist()) for name in first.schema.names}
    longest, width = max(map(len, texts)), max(len(text) for own in texts.values() for text in own) + 2
    shown = [name.ljust(longest) + "".join(x.rjust(width) for x in own) for name, own in texts.items()]
    return Printed({"rows": first.to_pylist()}, lines(shown))
