"""Commands that make and split datasets: init, generate, finalize, merge, split."""

from __future__ import annotations

import inspect
import re
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ibdata._numerics.naming import counted, rows_in_episodes, size
from ibdata.cli._options import (
    LOCAL,
    PlaceType,
    allow_code_option,
    configs,
    folder_argument,
    place_argument,
    progress_option,
    seed_option,
    set_option,
    workers_option,
)
from ibdata.cli._printing import Printable, Printed, contents, prints_result
from ibdata.dataset.tabular import pairs
from ibdata.errors import UsageError, meant

if TYPE_CHECKING:
    from ibdata.dataset.dataset import Dataset


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
    from ibdata.experiment.catalogue import write_template

    write_template(file)
    return Printed(
        {"file": str(file)}, f"{file}: edit it, then run ibdata generate --config {file} --dry-run"
    )


@click.command("generate")
@click.argument("config", required=False, metavar="CONFIG", shell_complete=configs)
@click.option(
    "--config", "option", metavar="CONFIG", shell_complete=configs, help="Same as the argument CONFIG."
)
@click.option(
    "--out",
    type=PlaceType(),
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
    help="Where the workers run: on this machine, or on Ray, whose hosts share DIR or reach the URL.",
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
    help="Make only part I of N, counted from 1. Several hosts that share DIR or reach the URL can make one "
    "part each; then `ibdata finalize` completes the dataset.",
)
@click.option(
    "--overwrite",
    is_flag=True,
    help="Replace the dataset in DIR, but none at a URL; it stays readable until the new one is complete. "
    "The unfinished run of another experiment is dropped at once.",
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
) -> Printable:
    """Generate the dataset of an experiment, or of each experiment in a folder.

    CONFIG is a YAML file, a folder of YAML files, or the name of a shipped experiment, as `ibdata config
    list` shows them.

    \b
    ibdata generate --config random.yaml
    ibdata generate --config safe.yaml --out data/safe-7 --seed 7 --set steps=50
    ibdata generate --config siemens-offline --dry-run
    ibdata generate --config random.yaml --shards $SLURM_ARRAY_TASK_ID/3
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
        part: Printable = result
        return part
    return _suite(result, seconds) if isinstance(result, Mapping) else _made(result, seconds)


def _counts(dataset: Dataset) -> dict[str, Any]:
    """The place, counts and content root of a dataset."""
    return {"out": dataset.place, **dataset.info["counts"], "content_root": dataset.content_root}


def _made(dataset: Dataset, seconds: float | None = None) -> Printed:
    """A dataset that a command made, perhaps with the seconds that it took."""
    data, lines = _counts(dataset), [("dataset", dataset.place), *contents(dataset)]
    if seconds is not None:
        data["seconds"] = seconds
        lines.append(("seconds", f"{seconds:.1f}"))
    return Printed(data, pairs(lines))


def _suite(datasets: Mapping[str, Dataset], seconds: float) -> Printed:
    """The datasets of a folder of experiments, and the seconds that they took."""
    folder = str(Path(next(iter(datasets.values())).place).parent)
    rows, size_of_all, lines, listed = 0, 0, [], []
    for name, dataset in datasets.items():
        rows += len(dataset)
        size_of_all += dataset.stored.manifest.data_bytes
        lines.append(f"{dataset.place}: {counted(len(dataset), 'row')}, content root {dataset.content_root}")
        listed.append({"name": name, **_counts(dataset)})
    total = [
        ("datasets", f"{len(datasets)} in {folder}"),
        ("rows", f"{rows:,}"),
        ("bytes", size(size_of_all)),
        ("time", f"{seconds:.1f} s"),
    ]
    data = {"out": folder, "datasets": listed, "rows": rows, "seconds": seconds}
    return Printed(data, "\n".join([*lines, "", pairs(total)]))


def _only_one(argument: str | None, option: str | None) -> str:
    """The config, which is an argument or an option."""
    if argument is not None and option is not None:
        raise click.UsageError(f"found CONFIG {argument!r} and --config {option!r}, expected one of them")
    config = option if argument is None else argument
    if config is None:
        raise click.UsageError("Missing argument 'CONFIG'; ibdata config list lists the shipped experiments.")
    return config


@click.command("finalize")
@place_argument
@prints_result
def finalize_command(folder: Path | str) -> Printed:
    """Complete a dataset whose parts were made by `ibdata generate --shards`.

    Every shard is checked first. If some are missing, the error names them and the command that makes them.

    \b
    ibdata generate --config random.yaml --out data/random --shards 1/2
    ibdata generate --config random.yaml --out data/random --shards 2/2
    ibdata finalize data/random
    """
    from ibdata.generation.generate import finalize

    return _made(finalize(folder))


@click.command("merge")
@click.argument("folders", metavar="DIR…", nargs=-1, required=True, type=LOCAL)
@click.option("--out", required=True, type=LOCAL, metavar="DIR", help="The folder to make.")
@prints_result
def merge_command(folders: tuple[Path, ...], out: Path) -> Printed:
    """Merge datasets with the same columns into a new one.

    Datasets that share an episode, or the beginning of one, are refused.

    \b
    ibdata merge data/random data/safe --out data/both
    """
    from ibdata.tools.merge import merge

    return _made(merge(folders, out))


@click.command("split")
@folder_argument
@click.argument("splits", metavar="[NAME=SPLIT]…", nargs=-1)
@click.option(
    "--by",
    type=click.Choice(["transfer", "leave-one-out", "episode", "policy"]),
    help="Make the splits of a scheme, whose arguments take the place of NAME=SPLIT.",
)
@click.option("--remove", multiple=True, metavar="NAME", help="Remove this split; may be repeated.")
@click.option("--list", "as_list", is_flag=True, help="Print the splits, and change nothing.")
@click.option(
    "--materialize",
    type=LOCAL,
    metavar="OUT",
    help="Write a copy to OUT in which each split has its own files.",
)
@prints_result
def split_command(
    folder: Path, splits: tuple[str, ...], by: str | None, as_list: bool, **options: Any
) -> Printed:
    """Split a dataset: label its episodes, or write a copy in which every split has its own files.

    A SPLIT is YAML, as in an experiment; NAME.KEY=VALUE sets one of its conditions. A split of the same name
    that was made so before is replaced.

    \b
    ibdata split data/random 'calm={setpoint: [10, 20]}' windy.setpoint=70
    ibdata split data/many --by transfer source=50 target=70 shots=2
    ibdata split data/many --by leave-one-out
    ibdata split data/many --by episode 'fractions=[0.7, 0.3]'
    ibdata split data/many --by policy
    ibdata split data/many --list
    ibdata split data/many --remove test
    ibdata split data/many --materialize data/many-files
    """
    from ibdata.dataset.dataset import Dataset, to_write

    if "=" in str(folder) and not folder.exists():
        raise click.UsageError(f"found {str(folder)!r} first, expected DIR before it")
    if as_list:
        if splits or by or any(options.values()):
            raise click.UsageError("--list changes nothing, but found more; give one of them")
        return _splits(Dataset(folder), {})
    from ibdata.tools.split import split
    from ibdata.tools.split_schemes import SCHEMES

    given, dataset = _assigned(splits), to_write(folder)
    if by:
        known = [*inspect.signature(SCHEMES[by]).parameters][1:]
        for name in given:
            if name not in known:
                expected = meant(name, known) if known else ", expected nothing more"
                raise UsageError(f"split by {by}: found {name!r}{expected}")
        given = SCHEMES[by](dataset, **given)
    before = {} if options["materialize"] else dataset.stored.splits
    return _splits(split(dataset, given, **options), before)


def _assigned(words: Sequence[str]) -> dict[str, Any]:
    """The values of words NAME=VALUE and NAME.KEY=VALUE."""
    from ibdata.experiment.yaml import Document, StrictYamlError

    for word in words:
        if not re.fullmatch(r"[^.=]+(\.[^.=]+){0,2}=.*", word, re.DOTALL):
            quoted = "'calm={setpoint: [10, 20]}'"
            raise UsageError(f"split: found {word!r}, expected NAME=SPLIT, in quotes such as {quoted}")
    assigned: dict[str, Any] = {}
    for word in words:
        name, _, text = word.partition("=")
        *parents, key = name.split(".")
        try:
            value = Document(text).data
        except StrictYamlError as error:
            raise UsageError(f"split {name}: {error.message}") from None
        place: Any = assigned
        for part in parents:
            place = place.setdefault(part, {}) if isinstance(place, dict) else None
        if not isinstance(place, dict) or key in place:
            raise UsageError(f"split {name}: found twice, expected once, with several values as [10, 20]")
        place[key] = value
    return assigned


def _splits(dataset: Dataset, before: Mapping[str, Any]) -> Printed:
    """The splits of a dataset, and what became of those that it had before."""
    now, splits = dataset.stored.splits, dataset.splits
    replaced = [name for name in before if name in now and before[name] != now[name]]
    removed = [name for name in before if name not in now]
    taken_away = {"replaced": replaced, "removed": removed}
    lines = [f"removed the split {name}" for name in removed]
    lines += [f"replaced the split {name}; another name keeps both" for name in replaced]
    width = max(map(len, splits), default=0)
    for name, split in splits.items():
        kind = "whole files" if split["declared"] else "labels"
        lines.append(f"{name.ljust(width)}  {rows_in_episodes(split['rows'], split['episodes'])} ({kind})")
    if not splits:
        lines.append(f"{dataset.place}: no splits")
    data = {
        "path": dataset.place,
        "splits": splits,
        "content_root": dataset.content_root,
        "taken_away": {change: names for change, names in taken_away.items() if names},
    }
    return Printed(data, "\n".join(lines))
