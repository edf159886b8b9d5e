from pathlib import Path

import click

from ibdata.cli._options import LOCAL, folder_argument, progress_option
from ibdata.cli._printing import Printed, lines, prints_result
from ibdata.cli._suggesting import Listing, summaries
from ibdata.plots import FORMS, plot, plots


@click.command(
    "plot", cls=Listing, title="Pictures", listed=lambda: summaries("ibdata.plots.dataset", plots())
)
@folder_argument
@click.option(
    "--out", type=LOCAL, metavar="FOLDER", help="The folder for the files; default figures/<name of DIR>."
)
@click.option(
    "--format", "form", type=click.Choice(FORMS), default="png", show_default=True, help="File format."
)
@click.option("--overwrite", is_flag=True, help="Replace files that exist.")
@progress_option
@prints_result
def command(folder: Path, out: Path | None, form: str, overwrite: bool, progress: bool | None) -> Printed:
    """Draw all pictures of a dataset and print the names of the files.

    \b
    ibdata plot data/random
    ibdata plot data/transfer --out pictures --format svg
    """
    files = list(map(str, plot(folder, out, form, overwrite, progress)))
    return Printed({"files": files}, lines(files))
