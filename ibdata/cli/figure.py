"""ibdata figure."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._shared import Listing, LocalPath, json_option, print_json, say, summaries
from ibdata.plots import DYNAMICS, figure, names


@click.command(
    "figure", cls=Listing, title="Figures", listed=lambda: summaries("ibdata.plots.paper", names())
)
@click.argument("name", type=click.Choice(names()))
@click.option(
    "--out",
    type=LocalPath(),
    metavar="FILE",
    help="A .png or .svg file; default figures/<name>.png.",
)
@click.option(
    "--dynamics", type=click.Choice(DYNAMICS), default="siemens", show_default=True, help="The variant."
)
@click.option("--seed", type=int, metavar="N", help="Seed of the episodes that are drawn.")
@click.option("--overwrite", is_flag=True, help="Replace the file if it exists.")
@json_option
def command(
    name: str, out: Path | None, dynamics: str, seed: int | None, overwrite: bool, as_json: bool
) -> None:
    """Draw a figure of the benchmark's paper and print the name of the file.

    \b
    ibdata figure landscape
    ibdata figure dynamics --dynamics paper --seed 3 --out dynamics-paper.svg
    """
    path = figure(name, out, dynamics, seed, overwrite)
    if as_json:
        print_json({"files": [str(path)]})
        return
    say(path)
