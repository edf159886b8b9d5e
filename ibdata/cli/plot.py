"""ibdata plot."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._shared import (
    Listing,
    LocalPath,
    folder_argument,
    json_option,
    print_json,
    quiet_option,
    say,
    summaries,
)
from ibdata.plots import FORMS, plot, plots


@click.command(
    "plot", cls=Listing, title="Pictures", listed=lambda: summaries("ibdata.plots.dataset", plots())
)
@folder_argument
@click.option(
    "--out",
    type=LocalPath(),
    metavar="FOLDER",
    help="The folder for the files; default figures/<name of DIR>.",
)
@click.option(
    "--format", "form", type=click.Choice(FORMS), default="png", show_default=True, help="File format."
)
@click.option("--overwrite", is_flag=True, help="Replace files that exist.")
@quiet_option
@json_option
def command(folder: Path, out: Path | None, form: str, overwrite: bool, quiet: bool, as_json: bool) -> None:
    """Draw all pictures of a dataset and print the names of the files.

    \b
    ibdata plot data/random
    ibdata plot data/transfer --out pictures --format svg
    """
    paths = plot(folder, out, form, overwrite, progress=False if quiet else None)
    if as_json:
        print_json({"files": [str(path) for path in paths]})
        return
    for path in paths:
        say(path)
