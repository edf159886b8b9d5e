"""Commands that make datasets: init, generate, finalize, merge."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from ibdata.cli._options import (
    LOCAL,
    Place,
    allow_code_option,
    configs,
    folder_argument,
    progress_option,
    seed_option,
    set_option,
    workers_option,
)
from ibdata.cli._printing import Printed, Result, prints_result
from ibdata.cli._results import Made, Suite
from ibdata.errors import UsageError


@click.command("init")
@click.argument("file", metavar="[FILE]", default="experiment.yaml", type=LOCAL)
@prints_result
def init_command(file: Path) -> Printed:
    """Write an example experiment with comments, for you to edit.

    FILE is experiment.yaml by default; an existing file is not changed.

    \b
    ibdata init
    ibdata init mine.yaml
    """
    from ibdata.experiment.template import write_template

    write_template(file)
    return Printed({"file": str(file)}, f"{file}: edit it, then run ibdata generate {file} --dry-run")


@click.command("generate")
@click.argument("config", required=False, metavar="CONFIG", shell_complete=configs)
@click.option(
    "--config", "option", metavar="CONFIG", shell_complete=configs, help="Same as the argument CONFIG."
)
@click.option(
    "--out",
    type=Place(),
    metavar="DIR|URL",
    help="The folder to make, or a URL such as s3://bucket/name; default data/<name>. The datasets of a "
    "folder of experiments go to DIR/<file>.",
)
@workers_option
@click.option(
    "--engine",
    type=click.Choice(["local", "ray"]),
    default="local",
    show_default=True,
    help="Where the workers run: on this machine, or on Ray, whose hosts must share the file system of DIR.",
)
@click.option(
    "--address",
    metavar="A",
    help="Address of a running Ray; default: $RAY_ADDRESS, or else a Ray that is started here.",
)
@seed_option
@set_option
@click.option(
    "--shards",
    metavar="I/N",
    help="Make only part I of N, counted from 1. Several hosts that share DIR can make one part each; then "
    "`ibdata finalize` completes the dataset.",
)
@click.option("--resume", is_flag=True, hidden=True, expose_value=False)  # a run always goes on
@click.option(
    "--overwrite",
    is_flag=True,
    help="Replace the dataset in DIR; it stays readable until the new one is complete.",
)
@click.option("--dry-run", is_flag=True, help="Tell the size and what would be done; write nothing.")
@allow_code_option
@progress_option
@prints_result
def generate_command(
    config: str | None,
    option: str | None,
    out: Path | str | None,
    dry_run: bool,
    shards: str | None,
    **settings: Any,
) -> Result:
    """Generate the dataset of an experiment, or of each experiment in a folder.

    CONFIG is a YAML file, a folder of YAML files, or the name of a shipped experiment, as `ibdata config
    list` shows them.

    \b
    ibdata generate random.yaml
    ibdata generate safe.yaml --out data/safe-7 --seed 7 --set steps=50
    ibdata generate siemens-offline --dry-run
    ibdata generate random.yaml --shards $SLURM_ARRAY_TASK_ID/3
    """
    config = _only_one(config, option)
    if dry_run:
        from ibdata.generation.estimate import estimate

        if shards is not None:
            raise UsageError("--shards: found --dry-run too, but these cannot be combined")
        for name in ("engine", "address", "progress", "workers"):
            del settings[name]
        return estimate(config, out, **settings)
    from ibdata.generation.generate import generate

    start = time.perf_counter()
    result = generate(config, out, shards=shards, **settings)
    seconds = time.perf_counter() - start
    if shards is not None:
        part: Result = result
        return part
    return Suite(result, seconds) if isinstance(result, Mapping) else Made(result, seconds)


def _only_one(argument: str | None, option: str | None) -> str:
    """The config, which is an argument or an option."""
    if argument is not None and option is not None:
        raise click.UsageError(f"found CONFIG {argument!r} and --config {option!r}, expected one of them")
    config = option if argument is None else argument
    if config is None:
        raise click.UsageError("Missing argument 'CONFIG'; ibdata config list lists the shipped experiments.")
    return config


@click.command("finalize")
@folder_argument
@prints_result
def finalize_command(folder: Path) -> Result:
    """Complete a dataset whose parts were made by `ibdata generate --shards`.

    Every shard is checked first. If some are missing, the error names them and the command that makes them.

    \b
    ibdata generate random.yaml --out data/random --shards 1/2
    ibdata generate random.yaml --out data/random --shards 2/2
    ibdata finalize data/random
    """
    from ibdata.generation.generate import finalize

    return Made(finalize(folder))


@click.command("merge")
@click.argument("folders", metavar="DIR…", nargs=-1, required=True, type=LOCAL)
@click.option("--out", required=True, type=LOCAL, metavar="DIR", help="The folder to make.")
@prints_result
def merge_command(folders: tuple[Path, ...], out: Path) -> Result:
    """Merge datasets with the same columns into a new one.

    Datasets that share an episode, or the beginning of one, are refused.

    \b
    ibdata merge data/random data/safe --out data/both
    """
    from ibdata.maintenance.merge import merge

    return Made(merge(folders, out))
