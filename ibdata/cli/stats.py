from pathlib import Path

import click

from ibdata.cli._options import place_argument, split_option
from ibdata.cli._printing import Printed, Result, prints_result, table

SHOWN = ("mean", "std", "min", "max")


@click.command("stats")
@place_argument
@split_option
@click.option(
    "--quality",
    "of_quality",
    is_flag=True,
    help="Print measures of the quality of the data instead. They read all rows.",
)
@prints_result
def command(folder: Path | str, split: str | None, of_quality: bool) -> Result:
    """Print mean, standard deviation, range and median of each column.

    \b
    ibdata stats data/random
    ibdata stats data/transfer --split target
    ibdata stats data/random --quality
    """
    from ibdata.dataset.reader import Dataset

    if of_quality:
        from ibdata.measures.quality import quality

        found = quality(folder, split)
        return Printed({"quality": found.plain()}, repr(found))
    columns = Dataset(folder).statistics(split)
    rows = [(name, *(stat[key] for key in SHOWN), stat["quantiles"]["0.5"]) for name, stat in columns.items()]
    return Printed({"columns": columns}, table(("column", *SHOWN, "median"), rows))
