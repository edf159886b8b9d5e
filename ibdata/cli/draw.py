"""Commands that draw: plot, and card with its report."""

from pathlib import Path
from typing import Any

import click

from ibdata.cli._options import LOCAL, folder_argument, progress_option, selects
from ibdata.cli._printing import Printed, lines, prints_result
from ibdata.cli._suggesting import Listing, summaries
from ibdata.plots import FORMS, plot, plots


@click.command(
    "plot", cls=Listing, title="Pictures", entries=lambda: summaries("ibdata.plots.dataset", plots())
)
@folder_argument
@selects
@click.option(
    "--out", type=LOCAL, metavar="FOLDER", help="The folder for the files; default figures/<name of DIR>."
)
@click.option(
    "--format", "form", type=click.Choice(FORMS), default="png", show_default=True, help="File format."
)
@click.option("--overwrite", is_flag=True, help="Replace files that exist.")
@progress_option
@prints_result
def plot_command(
    selection: Any, out: Path | None, form: str, overwrite: bool, progress: bool | None
) -> Printed:
    """Draw all pictures of a dataset and print the names of the files.

    \b
    ibdata plot data/random
    ibdata plot data/transfer --split target --out pictures --format svg
    """
    files = list(map(str, plot(selection, out, form, overwrite, progress)))
    return Printed({"files": files}, lines(files))


@click.command("card")
@folder_argument
@click.option("--overwrite", is_flag=True, help="Replace what has been edited.")
@prints_result
def card_command(folder: Path, overwrite: bool) -> Printed:
    """Write a dataset's card (README.md) and its report (report.html).

    The report shows pictures, returns, statistics, experiment and provenance in one file, which needs no
    network. Without matplotlib only the card is written.

    \b
    ibdata card data/random
    """
    from ibdata.maintenance.card import card

    written = card(folder, overwrite)
    files = [path.name for path in written]
    return Printed({"path": str(folder), "files": files}, lines(written))
