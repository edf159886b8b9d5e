"""The command export."""

from pathlib import Path
from typing import Any

import click

from ibdata.cli._options import (
    LOCAL,
    YAML,
    cost_option,
    folder_argument,
    progress_option,
    reward_option,
    selects,
)
from ibdata.cli._printing import Result, prints_result
from ibdata.cli._suggesting import Listing, summaries
from ibdata.exporters import FORMATS

VIEW = ("observe", "actions", "reward", "reward_scale", "imperfections", "cost")


def _observed(ctx: click.Context, param: click.Parameter, text: str) -> str | list[str]:
    names = [name.strip() for name in text.split(",")]
    return names if len(names) > 1 or text.startswith(("obs_", "latent_")) else text


@click.command("export", cls=Listing, title="Formats", entries=lambda: summaries("ibdata.exporters", FORMATS))
@folder_argument
@click.option(
    "--to",
    required=True,
    type=click.Choice(FORMATS),
    help="The format; see below.",
)
@click.option("--out", required=True, type=LOCAL, metavar="PATH", help="The file or folder to write.")
@selects
@click.option(
    "--history",
    type=int,
    metavar="N",
    help="Observations to stack, newest first; default 1, or 30 for neorl.",
)
@click.option(
    "--observe",
    metavar="COLUMNS",
    default="classic",
    callback=_observed,
    help="The observed columns: classic (6 variables), markov (the whole state), or names with commas, such "
    "as obs_gain,latent_mu_v.",
)
@click.option("--actions", is_flag=True, help="Observe the action of the step before too.")
@reward_option
@cost_option
@click.option("--reward-scale", type=float, default=1.0, metavar="X", help="Multiply rewards by X.")
@click.option(
    "--imperfections",
    type=YAML,
    metavar="YAML",
    help="Delay, noise, rounding and missing values of columns, such as '{delay: {obs_fatigue: 3}}'; "
    "docs/views.md lists them.",
)
@click.option("--id", metavar="ID", help="For minari: NAMESPACE/NAME-vN; default ibdata/<name>-v0.")
@click.option("--overwrite", is_flag=True, help="Replace an export that is there.")
@progress_option
@prints_result
def export_command(selection: Any, to: str, out: Path, **options: Any) -> Result:
    """Write a dataset in the format of another library, and print the Python code that loads it.

    Every transition is kept, including the last of each episode with its next observation. (Only if --observe
    names hidden columns, and the dataset does not have them after the last row, is that row left out, and the
    output says so.) Floats become float32, except in csv. The output appears only when it is complete.

    \b
    ibdata export data/random --to minari --out minari-datasets
    ibdata export data/transfer --to npz --out t.npz --split target --history 10
    ibdata export data/random --to npz --out best.npz --returns -250000 inf
    ibdata export data/random --to csv --out m.csv --observe markov --reward delta
    """
    from ibdata.exporters import export

    view = {name: options.pop(name) for name in VIEW}
    return export(selection, to, out, **options, view=view)
