"""Commands that use datasets and experiments: plot, card, export, config."""

import json
from pathlib import Path
from typing import Any

import click

from ibdata._numerics.naming import counted
from ibdata.cli._options import (
    LOCAL,
    YAML,
    Listing,
    Suggesting,
    configs,
    cost_option,
    folder_argument,
    progress_option,
    reward_option,
    seed_option,
    selects,
    set_option,
    summaries,
)
from ibdata.cli._printing import Printable, Printed, lines, print_json, prints_result
from ibdata.errors import printable
from ibdata.exporters import FORMATS
from ibdata.plots import FORMS, PICTURES, plot

VIEW = ("observe", "actions", "reward", "reward_scale", "imperfections", "cost")


@click.command(
    "plot",
    cls=Listing,
    title="Pictures",
    entries=lambda: [(name, caption) for name, (_, caption) in PICTURES.items()],
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
    from ibdata.tools.card import card

    written = card(folder, overwrite)
    files = [path.name for path in written]
    return Printed({"path": str(folder), "files": files}, lines(written))


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
    "the page 'Views and costs' lists them.",
)
@click.option("--id", metavar="ID", help="For minari: NAMESPACE/NAME-vN; default ibdata/<name>-v0.")
@click.option("--overwrite", is_flag=True, help="Replace an export that is there.")
@progress_option
@prints_result
def export_command(selection: Any, to: str, out: Path, **options: Any) -> Printable:
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


config_argument = click.argument("config", metavar="CONFIG", shell_complete=configs)


@click.group("config", cls=Suggesting)
def config_command() -> None:
    """List what experiments and policies there are, or check and show an experiment.

    CONFIG is a YAML file, a folder of YAML files, or the name of a shipped experiment.

    \b
    ibdata config list
    ibdata config validate my.yaml
    ibdata config show random --set episodes=100
    ibdata config schema > schema.json
    """


@config_command.command("list")
@prints_result
def list_() -> Printable:
    """List the experiments that come with ibdata: rows and a description; with --json, content roots, too.

    A name that ends with / is that of a folder of experiments.
    """
    from ibdata.experiment.catalogue import catalogue

    return catalogue()


@config_command.command("policies")
@prints_result
def policies_() -> Printed:
    """List the policies and their options, and the networks that come with ibdata."""
    from ibdata.evaluation.baselines import shipped_networks
    from ibdata.policies import policy_list

    kinds, networks = policy_list(), shipped_networks()
    lines = []
    for policy in kinds:
        lines.append(f"{policy['kind']}: {policy['summary']}")
        for option in policy["options"]:
            default = "required" if option["required"] else f"default {json.dumps(option['default'])}"
            lines.append(f"    {option['name']} ({default}): {option['description']}")
    lines.append("Networks, by name:")
    for network in networks:
        score = f" (score {network['score']:.1f})" if "score" in network else ""
        lines.append(f"    {network['name']}{score}: {network['provenance']}")
    return Printed({"policies": kinds, "networks": networks}, "\n".join(lines))


@config_command.command("validate")
@config_argument
@set_option
@seed_option
@prints_result
def validate(config: str, overrides: tuple[str, ...], seed: int | None) -> Printed:
    """Check an experiment, or all in a folder.

    Prints all errors at once; the exit code is 2 if there are any.
    """
    from ibdata.experiment import load_all

    folder, files, experiments = load_all(config, overrides, seed)
    rows = sum(experiment.rows for experiment in experiments)
    path = str(folder or files[0])
    return Printed({"config": path, "valid": True, "rows": rows}, f"{path}: valid, {counted(rows, 'row')}")


@config_command.command("show")
@config_argument
@set_option
@seed_option
@prints_result
def show(config: str, overrides: tuple[str, ...], seed: int | None) -> Printed:
    """Print an experiment in full, with overrides and defaults."""
    from ibdata.experiment import as_yaml, load

    experiment = load(config, overrides, seed)
    text = as_yaml(experiment).decode()
    if any(printable(line) != line for line in text.splitlines()):
        text = as_yaml(experiment, ascii=True).decode()
    return Printed(experiment.plain(), text)


@config_command.command("schema")
def schema() -> None:
    """Print the JSON Schema of experiments, for editors."""
    from ibdata.experiment import Experiment

    print_json(Experiment.model_json_schema(), indent=1)
