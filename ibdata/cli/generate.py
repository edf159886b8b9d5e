"""ibdata generate."""

from __future__ import annotations

import time
from pathlib import Path

import click

from ibdata.cli._shared import (
    allow_code_option,
    config_option,
    json_option,
    print_json,
    print_pairs,
    seed_option,
    set_option,
    size,
)


@click.command("generate")
@config_option
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="DIR", help="Folder to make; default data/<name>."
)
@click.option("--workers", type=int, metavar="N", help="Processes; default: one a processor.")
@seed_option
@set_option
@click.option("--resume", is_flag=True, help="Go on with a run that was stopped, or start one.")
@click.option("--overwrite", is_flag=True, help="Replace the dataset in DIR, which stays whole until then.")
@click.option("--dry-run", is_flag=True, help="Say what would be made, and write nothing.")
@allow_code_option
@click.option("--quiet", "-q", is_flag=True, help="No progress bar.")
@json_option
def command(
    config: str,
    out: Path | None,
    workers: int | None,
    seed: int | None,
    overrides: tuple[str, ...],
    resume: bool,
    overwrite: bool,
    dry_run: bool,
    allow_code: bool,
    quiet: bool,
    as_json: bool,
) -> None:
    """Make the dataset of an experiment.

    \b
    ibdata generate --config random.yaml
    ibdata generate --config safe.yaml --out data/safe-7 --seed 7 --set episodes=100
    ibdata generate --config transfer.yaml --dry-run
    """
    from ibdata.engines.estimate import estimate
    from ibdata.engines.generate import default_folder, generate, resolve

    experiment = resolve(config, overrides, seed)
    folder = out or default_folder(experiment)
    if dry_run:
        from ibdata.experiment import as_yaml

        made = estimate(experiment, folder, workers, resume, overwrite, allow_code)
        if as_json:
            print_json({"experiment": experiment.plain(), **made})
            return
        click.echo(as_yaml(experiment).decode())
        print_pairs(
            [
                ("out", f"{made['out']} (nothing is written)"),
                ("episodes", made["episodes"]),
                ("rows", made["rows"]),
                ("shards", made["shards"]),
                ("bytes", f"{made['bytes']} ({size(made['bytes'])}, estimated from a sample)"),
                (
                    "seconds",
                    f"{made['seconds']:.1f} with {made['workers']} workers (estimated from a sample)",
                ),
            ]
        )
        return
    start = time.perf_counter()
    dataset = generate(
        experiment,
        folder,
        workers=workers,
        resume=resume,
        overwrite=overwrite,
        progress=False if quiet else None,
        allow_code=allow_code,
    )
    seconds = time.perf_counter() - start
    counts = dataset.info["counts"]
    if as_json:
        print_json({"out": str(folder), **counts, "content_root": dataset.content_root, "seconds": seconds})
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
