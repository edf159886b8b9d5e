"""ibdata config validate, show and schema."""

from __future__ import annotations

import click

from ibdata.cli._completion import configs
from ibdata.cli._generating import say_yaml
from ibdata.cli._shared import Suggesting, json_option, print_json, say, say_json, seed_option, set_option
from ibdata.numerics.naming import counted


@click.group("config", cls=Suggesting)
def command() -> None:
    """Check an experiment, show it in full, or print the JSON Schema.

    CONFIG is a YAML file, a folder of YAML files, or the name of a shipped experiment.

    \b
    ibdata config validate my.yaml
    ibdata config show random --set episodes=100
    ibdata config schema > schema.json
    """


config_argument = click.argument("config", metavar="CONFIG", shell_complete=configs)


@command.command("validate")
@config_argument
@set_option
@seed_option
@json_option
def validate(config: str, overrides: tuple[str, ...], seed: int | None, as_json: bool) -> None:
    """Check an experiment, or all in a folder.

    Prints all errors at once; the exit code is 2 if there are any.
    """
    from ibdata.experiment import find, load_all

    rows = sum(experiment.rows for experiment in load_all(config, overrides, seed))
    if as_json:
        print_json({"config": str(find(config)), "valid": True, "rows": rows})
        return
    say(f"{find(config)}: valid, {counted(rows, 'row')}")


@command.command("show")
@config_argument
@set_option
@seed_option
@json_option
def show(config: str, overrides: tuple[str, ...], seed: int | None, as_json: bool) -> None:
    """Print an experiment in full, with overrides and defaults."""
    from ibdata.experiment import load

    experiment = load(config, overrides, seed)
    if as_json:
        print_json({"experiment": experiment.in_full()})
        return
    say_yaml(experiment)


@command.command("schema")
def schema() -> None:
    """Print the JSON Schema of experiments, for editors."""
    from ibdata.experiment import Experiment

    say_json(Experiment.model_json_schema(), indent=1)
