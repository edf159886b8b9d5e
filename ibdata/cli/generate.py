"""ibdata generate."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ibdata.cli._shared import (
    Place,
    allow_code_option,
    config_option,
    json_option,
    print_json,
    print_pairs,
    seed_option,
    set_option,
    size,
)
from ibdata.errors import UsageError

if TYPE_CHECKING:
    from ibdata.dataset.reader import Dataset
    from ibdata.experiment import Experiment


@click.command("generate")
@config_option
@click.option(
    "--out",
    type=Place(path_type=Path),
    metavar="DIR|URL",
    help="Folder to make, or URL as s3://bucket/name; default data/<name>. Of a folder of experiments each "
    "goes to DIR/<name>.",
)
@click.option("--workers", type=int, metavar="N", help="Processes; default: one a processor.")
@click.option(
    "--engine",
    type=click.Choice(["local", "ray"]),
    default="local",
    show_default=True,
    help="Who runs the files: processes here, or Ray, whose hosts must share the file system of DIR.",
)
@click.option("--address", metavar="A", help="A running Ray; default: $RAY_ADDRESS, else one started here.")
@seed_option
@set_option
@click.option(
    "--shards",
    metavar="I/N",
    help="Make the I-th of N parts only, I from 1: for N hosts and one folder; then ibdata finalize DIR.",
)
@click.option("--resume", is_flag=True, help="Go on with a run that was stopped, or start one.")
@click.option("--overwrite", is_flag=True, help="Replace the dataset in DIR, which stays whole until then.")
@click.option("--dry-run", is_flag=True, help="Say what would be made, and write nothing.")
@allow_code_option
@click.option("--quiet", "-q", is_flag=True, help="No progress bar.")
@json_option
def command(
    config: str,
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
    """Make the dataset of an experiment, or of each experiment in a folder.

    \b
    ibdata generate --config random.yaml
    ibdata generate --config safe.yaml --out data/safe-7 --seed 7 --set episodes=100
    ibdata generate --config siemens-offline --dry-run
    ibdata generate --config random.yaml --out data/random --shards $SLURM_ARRAY_TASK_ID/3
    """
    from ibdata.experiment import find
    from ibdata.experiment.shipped import is_suite

    changes: dict[str, Any] = {"overrides": overrides, "seed": seed}
    common: dict[str, Any] = {"workers": workers, "allow_code": allow_code}
    running: dict[str, Any] = {"progress": False if quiet else None, "engine": engine, "address": address}
    whole: dict[str, Any] = {"resume": resume, "overwrite": overwrite}
    suite = is_suite(find(config))
    if shards is not None:
        _refuse_with_shards(suite, overwrite, dry_run)
        _generate_shards(config, shards, out, as_json, **changes, **common, **running)
    elif suite and dry_run:
        _estimate_all(config, out, as_json, **changes, **common, **whole)
    elif suite:
        _generate_all(config, out, as_json, **changes, **common, **running, **whole)
    else:
        from ibdata.engines.generate import default_folder, resolve

        experiment = resolve(config, **changes)
        folder = out or default_folder(experiment)
        if dry_run:
            _estimate(experiment, folder, as_json, **common, **whole)
        else:
            _generate(experiment, folder, as_json, **common, **running, **whole)


def _estimate(experiment: Experiment, folder: Path | str, as_json: bool, **options: Any) -> None:
    from ibdata.engines.estimate import estimate
    from ibdata.experiment import as_yaml

    made = estimate(experiment, folder, **options)
    if as_json:
        print_json({"experiment": experiment.plain(), **made})
        return
    click.echo(as_yaml(experiment).decode())
    _print_estimate(made)


def _estimate_all(config: str, out: Path | str | None, as_json: bool, **options: Any) -> None:
    from ibdata.engines.suite import estimate_all

    made = estimate_all(config, out, **options)
    total = {key: sum(m[key] for m in made) for key in ("episodes", "rows", "shards", "bytes", "seconds")}
    total |= {"out": str(Path(made[0]["out"]).parent), "workers": max(m["workers"] for m in made)}
    if as_json:
        print_json({"experiments": made, **total})
        return
    for m in made:
        click.echo(f"{m['name']}: {m['rows']} rows, {size(m['bytes'])}, {m['seconds']:.1f} s")
    click.echo()
    _print_estimate(total)


def _print_estimate(made: dict[str, Any]) -> None:
    print_pairs(
        [
            ("out", f"{made['out']} (nothing is written)"),
            ("episodes", made["episodes"]),
            ("rows", made["rows"]),
            ("shards", made["shards"]),
            ("bytes", f"{made['bytes']} ({size(made['bytes'])}, estimated from a sample)"),
            ("seconds", f"{made['seconds']:.1f} with {made['workers']} workers (estimated from a sample)"),
        ]
    )


def _generate(experiment: Experiment, folder: Path | str, as_json: bool, **options: Any) -> None:
    from ibdata.engines.generate import generate

    start = time.perf_counter()
    dataset = generate(experiment, folder, **options)
    seconds = time.perf_counter() - start
    counts = dataset.info["counts"]
    if as_json:
        print_json({**_described(dataset), "seconds": seconds})
        return
    print_pairs(
        [
            ("dataset", folder),
            ("rows", f"{counts['rows']} in {counts['episodes']} episodes of {counts['steps']} steps"),
            ("files", f"{counts['shards']} Parquet, {size(counts['data_bytes'])}"),
            ("content root", dataset.content_root),
            ("time", f"{seconds:.1f} s"),
        ]
    )


def _refuse_with_shards(suite: bool, overwrite: bool, dry_run: bool) -> None:
    others = {"--overwrite": overwrite, "--dry-run": dry_run, "a folder of experiments": suite}
    for name, found in others.items():
        if found:
            raise UsageError(f"--shards: found {name} with it, expected one experiment and no {name}")


def _generate_shards(config: str, shards: str, out: Path | str | None, as_json: bool, **options: Any) -> None:
    from ibdata.engines.array import generate_shards

    made = generate_shards(config, shards, out, **options)
    if as_json:
        print_json(
            {
                "out": str(made.folder),
                "range": shards,
                "shards": made.shards,
                "rows": made.rows,
                "missing": made.missing,
            }
        )
        return
    click.echo(f"{made.folder}: {made.shards} shards with {made.rows} rows are there for {shards}")
    if made.missing:
        click.echo(
            f"{made.missing} shards are missing yet; when all are there: ibdata finalize {made.folder}"
        )
    else:
        click.echo(f"all shards are there: ibdata finalize {made.folder}")


def _generate_all(config: str, out: Path | str | None, as_json: bool, **options: Any) -> None:
    from ibdata.engines.suite import generate_all

    start = time.perf_counter()
    made = generate_all(config, out, **options)
    seconds = time.perf_counter() - start
    folder = next(iter(made.values())).path.parent
    rows, data_bytes = (sum(d.info["counts"][key] for d in made.values()) for key in ("rows", "data_bytes"))
    if as_json:
        datasets = [{"name": name, **_described(dataset)} for name, dataset in made.items()]
        print_json({"out": str(folder), "datasets": datasets, "rows": rows, "seconds": seconds})
        return
    for dataset in made.values():
        click.echo(f"{dataset.path}: {len(dataset)} rows, content root {dataset.content_root}")
    click.echo()
    print_pairs(
        [
            ("datasets", f"{len(made)} in {folder}"),
            ("rows", rows),
            ("bytes", size(data_bytes)),
            ("time", f"{seconds:.1f} s"),
        ]
    )


def _described(dataset: Dataset) -> dict[str, Any]:
    return {"out": dataset.place, **dataset.info["counts"], "content_root": dataset.content_root}
