"""ibdata plot."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._shared import docstring_of, folder_argument, json_option, print_json, say
from ibdata.plots import FORMS, plot, plots


class _WithPictures(click.Command):
    """A command whose help ends with the docstring of each picture, read without importing it."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Pictures"):
            formatter.write_dl([(name, docstring_of(f"ibdata.plots.dataset.{name}")) for name in plots()])


@click.command("plot", cls=_WithPictures)
@folder_argument
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="The folder for the files; default figures/<name of DIR>.",
)
@click.option(
    "--format", "form", type=click.Choice(FORMS), default="png", show_default=True, help="File format."
)
@click.option("--overwrite", is_flag=True, help="Replace files that exist.")
@json_option
def command(folder: Path, out: Path | None, form: str, overwrite: bool, as_json: bool) -> None:
    """Draw pictures of a dataset and print the names of their files.

    \b
    ibdata plot data/random
    ibdata plot data/transfer --out pictures --format svg
    """
    paths = plot(folder, out, form, overwrite)
    if as_json:
        print_json({"files": [str(path) for path in paths]})
        return
    for path in paths:
        say(path)
