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
    help="The folder for the files.",
)
@click.option(
    "--format", "form", type=click.Choice(FORMS), default="png", show_default=True, help="File format."
)
@click.option("--overwrite", is_flag=True, help="Replace files that exist.")
@json_option
def command(folder: Path, out: Path, form: str, overwrite: bool, as_json: bool) -> None:
    """Draw seven pictures of a dataset and print the names of their files.

    \b
    actions    distribution of the actions of each policy
    coverage   visits of each pair of velocity, gain and shift
    returns    returns of episodes, by setpoint and policy
    rewards    rewards of steps, by setpoint
    splits     setpoints and policies of each split, and shared episodes
    traces     the episode with the median return, step by step
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
