"""The commands of config."""

import json

import click

from ibdata.cli._options import Suggesting, configs, seed_option, set_option
from ibdata.cli._printing import Printed, Result, print_json, prints_result
from ibdata.errors import printable
from ibdata.numerics.naming import counted

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
def list_() -> Result:
    """List the experiments that come with ibdata, with their rows and a description.

    A name that ends with / is that of a folder of experiments.
    """
    from ibdata.experiment.shipped import catalogue

    return catalogue()


@config_command.command("policies")
@prints_result
def policies() -> Printed:
    """List the policies and their options."""
    from ibdata.policies import described

    kinds = described()
    lines = []
    for policy in kinds:
        lines.append(f"{policy['kind']}: {policy['summary']}")
        for option in policy["options"]:
            default = "required" if option["required"] else f"default {json.dumps(option['default'])}"
            lines.append(f"    {option['name']} ({default}): {option['description']}")
    return Printed({"policies": kinds}, "\n".join(lines))


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

    path, experiments = load_all(config, overrides, seed)
    rows = sum(experiment.rows for experiment in experiments)
    text = f"{path}: valid, {counted(rows, 'row')}"
    return Printed({"config": str(path), "valid": True, "rows": rows}, text)


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
