"""ibdata stats."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._completion import splits
from ibdata.cli._shared import json_option, place_argument, print_json, say

SHOWN = ("mean", "std", "min", "max")


@click.command("stats")
@place_argument
@click.option("--split", metavar="NAME", shell_complete=splits, help="Use only rows of this split.")
@click.option(
    "--quality",
    "of_quality",
    is_flag=True,
    help="Print measures of the quality of the data instead. They read all rows.",
)
@json_option
def command(folder: Path | str, split: str | None, of_quality: bool, as_json: bool) -> None:
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
        if as_json:
            print_json({"quality": found.plain()})
        else:
            for line in repr(found).splitlines():
                say(line)
        return
    columns = Dataset(folder).statistics(split)
    if as_json:
        print_json({"columns": columns})
        return
    width = max(map(len, columns))
    say(" " * width + "".join(name.rjust(14) for name in (*SHOWN, "median")))
    for name, stat in columns.items():
        numbers = [*(stat[key] for key in SHOWN), stat["quantiles"]["0.5"]]
        shown = ("-" if x is None else f"{x:.6g}" for x in numbers)
        say(name.ljust(width) + "".join(x.rjust(14) for x in shown))
