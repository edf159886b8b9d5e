from pathlib import Path

import click

from ibdata.cli._options import LOCAL
from ibdata.cli._printing import Printed, prints_result
from ibdata.cli._suggesting import Listing, summaries
from ibdata.plots import DYNAMICS, figure, names


@click.command(
    "figure", cls=Listing, title="Figures", listed=lambda: summaries("ibdata.plots.paper", names())
)
@click.argument("name", type=click.Choice(names()))
@click.option("--out", type=LOCAL, metavar="FILE", help="A .png or .svg file; default figures/<name>.png.")
@click.option(
    "--dynamics", type=click.Choice(DYNAMICS), default="siemens", show_default=True, help="The variant."
)
@click.option("--seed", type=int, metavar="N", help="Seed of the episodes that are drawn.")
@click.option("--overwrite", is_flag=True, help="Replace the file if it exists.")
@prints_result
def command(name: str, out: Path | None, dynamics: str, seed: int | None, overwrite: bool) -> Printed:
    """Draw a figure of the benchmark's paper and print the name of the file.

    \b
    ibdata figure landscape
    ibdata figure dynamics --dynamics paper --seed 3 --out dynamics-paper.svg
    """
    path = figure(name, out, dynamics, seed, overwrite)
    return Printed({"files": [str(path)]}, str(path))
