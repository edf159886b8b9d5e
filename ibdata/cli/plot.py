"""ibdata plot."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._shared import folder_argument, json_option, print_json, say
from ibdata.plots import FOLDER, FORMS, plot


@click.command("plot")
@folder_argument
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    default=FOLDER,
    show_default=True,
    help="Where the files go.",
)
@click.option("--format", "form", type=click.Choice(FORMS), default="png", show_default=True)
@click.option("--overwrite", is_flag=True, help="Replace files that exist.")
@json_option
def command(folder: Path, out: Path, form: str, overwrite: bool, as_json: bool) -> None:
    """Draw a dataset into seven files and print their names.

    \b
    actions    what each policy did
    coverage   how often each pair of velocity, gain and shift was visited
    returns    of episodes, by setpoint and policy
    rewards    of steps, by setpoint
    splits     which of them hold which setpoints and policies, what they share
    traces     of the episode with the median return
    tradeoff   fatigue against consumption

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
