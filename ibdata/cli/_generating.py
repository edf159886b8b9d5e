"""What `ibdata generate` runs and prints for one dataset, a folder of experiments, a part, or an estimate."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ibdata.cli._shared import print_json, print_pairs, say, say_all, shown, size
from ibdata.errors import UsageError
from ibdata.numerics.naming import counted

if TYPE_CHECKING:
    from ibdata.dataset.reader import Dataset
    from ibdata.experiment import Experiment


def say_yaml(experiment: Experiment) -> None:
    """Print an experiment as YAML; characters that the stream cannot show become escapes of YAML."""
    from ibdata.experiment import in_full

    text = in_full(experiment).decode()
    plain = all(shown(line, sys.stdout) == line for line in text.split("\n"))
    say_all(text if plain else in_full(experiment, ascii=True).decode())


def estimate_one(experiment: Experiment, folder: Path | str, as_json: bool, **options: Any) -> None:
    """Print what one experiment would make."""
    from ibdata.generation.estimate import preview

    made = preview(experiment, folder, **options)
    if as_json:
        print_json({"experiment": experiment.in_full(), **made})
        return
    say_yaml(experiment)
    say()
    _print_estimate(made)


def estimate_suite(config: str, out: Path | str | None, as_json: bool, **options: Any) -> None:
    """Print what each experiment of a folder would make, and the total."""
    from ibdata.generation.suite import preview_all

    made = preview_all(config, out, **options)
    total = {key: sum(m[key] for m in made) for key in ("episodes", "rows", "shards", "bytes", "seconds")}
    total |= {"out": str(Path(made[0]["out"]).parent), "workers": max(m["workers"] for m in made)}
    if as_json:
        print_json({"experiments": made, **total})
        return
    for m in made:
        say(f"{m['name']}: {counted(m['rows'], 'row')}, {size(m['bytes'])}, {m['seconds']:.1f} s")
        if m["folder"]:
            say(f"    {m['folder']}")
    say()
    _print_estimate(total)


def _print_estimate(made: Mapping[str, Any]) -> None:
    print_pairs(
        [
            ("out", f"{made['out']} (nothing is written)"),
            *((name, f"{made[name]:,}") for name in ("episodes", "rows", "shards")),
            ("bytes", f"{made['bytes']:,} ({size(made['bytes'])}, estimated from a sample)"),
            (
                "seconds",
                f"{made['seconds']:,.1f} with {counted(made['workers'], 'worker')} (estimated from a sample)",
            ),
            *([("folder", made["folder"])] if made.get("folder") else []),
        ]
    )


def generate_one(experiment: Experiment, folder: Path | str, as_json: bool, **options: Any) -> None:
    """Make one dataset."""
    from ibdata.generation.generate import generate

    start = time.perf_counter()
    dataset = generate(experiment, folder, **options)
    seconds = time.perf_counter() - start
    counts = dataset.info_model.counts
    if as_json:
        print_json({**_described(dataset), "seconds": seconds})
        return
    contents = f"{counted(counts.episodes, 'episode')} of {counted(experiment.steps, 'step')}"
    print_pairs(
        [
            ("dataset", folder),
            ("rows", f"{counts.rows:,} in {contents}"),
            ("files", f"{counts.shards:,} Parquet, {size(dataset.manifest_model.data_bytes)}"),
            ("content root", dataset.content_root),
            ("time", f"{seconds:.1f} s"),
        ]
    )


def refuse_with_part(suite: bool, overwrite: bool, dry_run: bool) -> None:
    """Raise UsageError for options that cannot be combined with --shards."""
    others = {"--overwrite": overwrite, "--dry-run": dry_run, "a folder of experiments": suite}
    for name, found in others.items():
        if found:
            raise UsageError(f"--shards: found {name} too, but these cannot be combined")


def generate_part(config: str, shards: str, out: Path | str | None, as_json: bool, **options: Any) -> None:
    """Make a part of a dataset's files."""
    from ibdata.generation.array_job import generate_shards

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
    contents = f"{counted(made.shards, 'shard')} with {counted(made.rows, 'row')}"
    say(f"{made.folder}: part {shards} is complete: {contents}")
    if made.missing:
        missing = f"{counted(made.missing, 'shard')} {'is' if made.missing == 1 else 'are'} missing"
        say(f"{missing}; when all are complete, run ibdata finalize {made.folder}")
    else:
        say(f"all shards are complete; run ibdata finalize {made.folder}")


def generate_suite(config: str, out: Path | str | None, as_json: bool, **options: Any) -> None:
    """Make the datasets of a folder of experiments."""
    from ibdata.generation.suite import generate_all

    start = time.perf_counter()
    made = generate_all(config, out, **options)
    seconds = time.perf_counter() - start
    folder = next(iter(made.values())).path.parent
    counts = [dataset.info_model.counts for dataset in made.values()]
    rows = sum(c.rows for c in counts)
    data_bytes = sum(dataset.manifest_model.data_bytes for dataset in made.values())
    if as_json:
        datasets = [{"name": name, **_described(dataset)} for name, dataset in made.items()]
        print_json({"out": str(folder), "datasets": datasets, "rows": rows, "seconds": seconds})
        return
    for dataset in made.values():
        say(f"{dataset.place}: {counted(len(dataset), 'row')}, content root {dataset.content_root}")
    say()
    print_pairs(
        [
            ("datasets", f"{len(made)} in {folder}"),
            ("rows", f"{rows:,}"),
            ("bytes", size(data_bytes)),
            ("time", f"{seconds:.1f} s"),
        ]
    )


def _described(dataset: Dataset) -> Mapping[str, Any]:
    return {"out": dataset.place, **dataset.info["counts"], "content_root": dataset.content_root}
