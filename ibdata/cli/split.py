"""ibdata split."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ibdata.cli._completion import splits
from ibdata.cli._shared import LocalPath, folder_argument, json_option, print_json, say, within
from ibdata.maintenance.split_options import DEFAULT_SCHEME, OPTIONS, SCHEMES

if TYPE_CHECKING:
    from ibdata.dataset.reader import Dataset


class Fractions(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer clicks
    """Numbers separated by commas."""

    name = "fractions"

    def convert(
        self, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        try:
            return tuple(float(part) for part in value.split(","))
        except ValueError:
            self.fail(f"found {value!r}, expected numbers such as 0.8,0.1,0.1", param, ctx)


class Renaming(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer clicks
    """Two names with = between them."""

    name = "renaming"

    def convert(
        self, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, str]:
        made, _, name = value.partition("=")
        if not (made and name):
            self.fail(f"found {value!r}, expected two names such as source=at-50", param, ctx)
        return made, name


@click.command("split")
@folder_argument
@click.option(
    "--by",
    type=click.Choice(list(OPTIONS)),
    help="The property that decides the split of an episode; default: the one that the other options imply.",
)
@click.option(
    "--scheme",
    type=click.Choice(list(SCHEMES)),
    help=f"By setpoint: how to split the setpoints; default {DEFAULT_SCHEME}.",
)
@click.option("--source", type=float, multiple=True, metavar="P", help="A source setpoint; may be repeated.")
@click.option("--target", type=float, multiple=True, metavar="P", help="A target setpoint; may be repeated.")
@click.option("--shots", type=int, metavar="N", help="Episodes per policy and target setpoint; default: all.")
@click.option("--transitions", type=int, metavar="N", help="Like --shots, but a number of rows.")
@click.option(
    "--within",
    type=float,
    metavar="D",
    help="With --scheme distance: the largest distance of a near setpoint from the source.",
)
@click.option(
    "--fractions",
    type=Fractions(),
    metavar="F,F,…",
    help="By episode: the shares of train, validation and test, or of train and test; default 0.8,0.1,0.1.",
)
@click.option("--prefix", metavar="NAME", help="Name the new splits NAME-source, NAME-target, …")
@click.option(
    "--name",
    "names",
    type=Renaming(),
    multiple=True,
    metavar="SPLIT=NAME",
    help="Name one of the new splits, e.g. --name source=at-50; may be repeated.",
)
@click.option(
    "--remove",
    multiple=True,
    metavar="NAME",
    shell_complete=splits,
    help="Remove this split; may be repeated.",
)
@click.option("--list", "as_list", is_flag=True, help="Print the splits, and change nothing.")
@click.option(
    "--materialize",
    type=LocalPath(),
    metavar="OUT",
    help="Write a copy to OUT in which each split has its own files.",
)
@json_option
def command(
    folder: Path, names: tuple[tuple[str, str], ...], as_list: bool, as_json: bool, **options: Any
) -> None:
    """Split a dataset: label its episodes, or write a copy in which every split has its own files.

    \b
    ibdata split data/random --by setpoint --source 50 --target 70
    ibdata split data/random --scheme leave-one-out --prefix fold
    ibdata split data/many --by episode --fractions 0.7,0.3
    ibdata split data/many --list
    ibdata split data/many --remove test
    ibdata split data/many --materialize data/many-files
    """
    from ibdata.dataset.reader import Dataset

    if as_list:
        _refuse_with_list({**options, "name": names})
        _print(Dataset(folder), as_json, {})
        return
    from ibdata.maintenance.split import split

    before = Dataset(folder).split_entries
    after = split(folder, names=dict(names), **options)
    _print(after, as_json, {} if options["materialize"] else _taken_away(before, after.split_entries))


def _refuse_with_list(options: Mapping[str, Any]) -> None:
    for option, value in options.items():
        if value not in (None, ()):
            raise click.UsageError(f"--list changes nothing, but found --{option} too; give one of them")


def _taken_away(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, list[str]]:
    """The names of the splits that were replaced or removed."""
    found = {
        "replaced": [name for name in before if name in after and before[name] != after[name]],
        "removed": [name for name in before if name not in after],
    }
    return {key: names for key, names in found.items() if names}


def _print(dataset: Dataset, as_json: bool, taken_away: Mapping[str, list[str]]) -> None:
    splits = dataset.splits
    if as_json:
        root = dataset.content_root
        print_json(
            {"path": str(dataset.path), "splits": splits, "content_root": root, "taken_away": taken_away}
        )
        return
    for name in taken_away.get("removed", []):
        say(f"removed the split {name}")
    for name in taken_away.get("replaced", []):
        say(f"replaced the split {name}; --prefix or --name keeps both")
    width = max(map(len, splits), default=0)
    for name, made in splits.items():
        kind = "whole files" if made["declared"] else "labels"
        say(f"{name.ljust(width)}  {within(made['rows'], made['episodes'])} ({kind})")
    if not splits:
        say(f"{dataset.path}: no splits")
