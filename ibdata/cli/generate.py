"""ibdata generate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ibdata.cli._completion import configs
from ibdata.cli._generating import (
    estimate_one,
    estimate_suite,
    generate_one,
    generate_part,
    generate_suite,
    refuse_with_part,
)
from ibdata.cli._shared import (
    Place,
    allow_code_option,
    json_option,
    quiet_option,
    seed_option,
    set_option,
)


@click.command("generate")
@click.argument("config", required=False, metavar="CONFIG", shell_complete=configs)
@click.option(
    "--config",
    "config_option",
    metavar="CONFIG",
    shell_complete=configs,
    help="Same as the argument CONFIG.",
)
@click.option(
    "--out",
    type=Place(path_type=Path),
    metavar="DIR|URL",
    help="The folder to make, or a URL such as s3://bucket/name; default data/<name>. The datasets of a "
    "folder of experiments go to DIR/<name>.",
)
@click.option("--workers", type=int, metavar="N", help="Worker processes; default: chosen by the work.")
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
@click.option("--resume", is_flag=True, help="Continue a run that was stopped, or start one.")
@click.option(
    "--overwrite",
    is_flag=True,
    help="Replace the dataset in DIR; it stays readable until the new one is complete.",
)
@click.option("--dry-run", is_flag=True, help="Estimate size and duration, and write nothing.")
@allow_code_option
@quiet_option
@json_option
def command(
    config: str | None,
    config_option: str | None,
    out: Path | str | None,
    workers: int | None,
    engine: str,
    address: str | None,
    seed: int | None,
    overrides: tuple[str, ...],
    shards: str | None,
    resume: bool,
    overwrite: bool,
    dry_run: bool,
    allow_code: bool,
    quiet: bool,
    as_json: bool,
) -> None:
    """Generate the dataset of an experiment, or of each experiment in a folder.

    CONFIG is a YAML file, a folder of YAML files, or the name of a shipped experiment: see ibdata configs.

    \b
    ibdata generate random.yaml
    ibdata generate safe.yaml --out data/safe-7 --seed 7 --set steps=50
    ibdata generate siemens-offline --dry-run
    ibdata generate random.yaml --shards $SLURM_ARRAY_TASK_ID/3
    """
    from ibdata.experiment import find
    from ibdata.experiment.shipped import is_suite

    config = _only_one(config, config_option)
    changes: dict[str, Any] = {"overrides": overrides, "seed": seed}
    common: dict[str, Any] = {"workers": workers, "allow_code": allow_code}
    running: dict[str, Any] = {"progress": False if quiet else None, "engine": engine, "address": address}
    whole: dict[str, Any] = {"resume": resume, "overwrite": overwrite}
    suite = is_suite(find(config))
    if shards is not None:
        refuse_with_part(suite, overwrite, dry_run)
        generate_part(config, shards, out, as_json, **changes, **common, **running)
    elif suite and dry_run:
        estimate_suite(config, out, as_json, **changes, **common, **whole)
    elif suite:
        generate_suite(config, out, as_json, **changes, **common, **running, **whole)
    else:
        from ibdata.experiment import load
        from ibdata.generation.generate import default_folder

        experiment = load(config, **changes)
        folder = out or default_folder(experiment)
        if dry_run:
            estimate_one(experiment, folder, as_json, **common, **whole)
        else:
            generate_one(experiment, folder, as_json, **common, **running, **whole)


def _only_one(argument: str | None, option: str | None) -> str:
    """The config, which is an argument or an option."""
    if argument is not None and option is not None:
        raise click.UsageError(f"found CONFIG {argument!r} and --config {option!r}, expected one of them")
    config = option if argument is None else argument
    if config is None:
        raise click.UsageError("Missing argument 'CONFIG'; ibdata configs lists the shipped experiments.")
    return config
