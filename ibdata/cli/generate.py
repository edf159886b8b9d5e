from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ibdata.cli._options import (
    Place,
    allow_code_option,
    configs,
    progress_option,
    seed_option,
    set_option,
    workers_option,
)
from ibdata.cli._printing import Printed, described, made, pairs, prints_result, size
from ibdata.errors import UsageError
from ibdata.numerics.naming import counted

if TYPE_CHECKING:
    from ibdata.dataset.reader import Dataset
    from ibdata.generation.array_job import PartMade


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
@click.option("--resume", is_flag=True, help="Continue a run that was stopped, or start one.")
@click.option(
    "--overwrite",
    is_flag=True,
    help="Replace the dataset in DIR; it stays readable until the new one is complete.",
)
@click.option("--dry-run", is_flag=True, help="Estimate size and duration, and write nothing.")
@allow_code_option
@progress_option
@prints_result
def command(
    config: str | None,
    option: str | None,
    out: Path | str | None,
    dry_run: bool,
    shards: str | None,
    **settings: Any,
) -> Printed:
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
        return _dry_run(config, out, shards, settings)
    from ibdata.generation.generate import generate

    start = time.perf_counter()
    found = generate(config, out, shards=shards, **settings)
    seconds = time.perf_counter() - start
    if shards is not None:
        return _part(found, shards)
    return _suite(found, seconds) if isinstance(found, Mapping) else made(found, seconds)


def _only_one(argument: str | None, option: str | None) -> str:
    """The config, which is an argument or an option."""
    if argument is not None and option is not None:
        raise click.UsageError(f"found CONFIG {argument!r} and --config {option!r}, expected one of them")
    config = option if argument is None else argument
    if config is None:
        raise click.UsageError("Missing argument 'CONFIG'; ibdata config list lists the shipped experiments.")
    return config


def _suite(found: Mapping[str, Dataset], seconds: float) -> Printed:
    datasets = list(found.values())
    folder, rows = str(Path(datasets[0].place).parent), sum(map(len, datasets))
    lines = [f"{d.place}: {counted(len(d), 'row')}, content root {d.content_root}" for d in datasets]
    total = [
        ("datasets", f"{len(datasets)} in {folder}"),
        ("rows", f"{rows:,}"),
        ("bytes", size(sum(d.stored.manifest.data_bytes for d in datasets))),
        ("time", f"{seconds:.1f} s"),
    ]
    listed = [{"name": name, **described(dataset)} for name, dataset in found.items()]
    plain = {"out": folder, "datasets": listed, "rows": rows, "seconds": seconds}
    return Printed(plain, "\n".join([*lines, "", pairs(total)]))


def _part(part: PartMade, shards: str) -> Printed:
    plain = {**part._asdict(), "out": str(part.folder), "range": shards}
    del plain["folder"]
    left = "all shards are complete"
    if part.missing:
        left = f"shards that are still missing: {part.missing:,}; when all are complete"
    text = (
        f"{part.folder}: part {shards} is complete: {counted(part.shards, 'shard')} with "
        f"{counted(part.rows, 'row')}\n{left}, run ibdata finalize {part.folder}"
    )
    if not part.shards:
        text += "\nthere are fewer shards than parts; a smaller output.shard_rows makes more"
    return Printed(plain, text)


def _dry_run(config: str, out: Path | str | None, shards: str | None, settings: dict[str, Any]) -> Printed:
    """What `generate` would make, and what it would do with what is at its place."""
    from ibdata.generation.estimate import estimate

    if shards is not None:
        raise UsageError("--shards: found --dry-run too, but these cannot be combined")
    for name in ("engine", "address", "progress"):
        del settings[name]
    found = estimate(config, out, **settings)
    lines = []
    for run in found.get("experiments", []):
        lines.append(
            f"{run['out']}: {counted(run['rows'], 'row')}, {size(run['bytes'])}, {run['seconds']:.1f} s"
        )
    if lines:
        lines.append("")
    workers = counted(found["workers"], "worker")
    total = [
        ("out", f"{found['out']} (nothing is written)"),
        *((name, f"{found[name]:,}") for name in ("episodes", "rows", "shards")),
        ("bytes", f"{found['bytes']:,} ({size(found['bytes'])}, estimated from a sample)"),
        ("seconds", f"{found['seconds']:,.1f} with {workers} (estimated from a sample)"),
    ]
    return Printed(found, "\n".join([*lines, pairs(total)]))
