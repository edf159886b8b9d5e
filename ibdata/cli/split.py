"""The command split."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ibdata.cli._options import LOCAL, folder_argument
from ibdata.cli._printing import Result, prints_result
from ibdata.cli._results import Splits
from ibdata.maintenance.split_options import DEFAULT_SCHEME, OPTIONS, SCHEMES


def _fractions(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[float, ...] | None:
    if value is None:
        return None
    try:
        return tuple(float(part) for part in value.split(","))
    except ValueError:
        raise click.BadParameter(f"found {value!r}, expected numbers such as 0.8,0.1,0.1") from None


def _names(ctx: click.Context, param: click.Parameter, values: tuple[str, ...]) -> dict[str, str]:
    pairs = [value.partition("=")[::2] for value in values]
    for value, (split, name) in zip(values, pairs, strict=True):
        if not (split and name):
            raise click.BadParameter(f"found {value!r}, expected two names such as source=at-50")
    return dict(pairs)


@click.command("split")
@folder_argument
@click.option(
    "--by",
    type=click.Choice(list(OPTIONS)),
    help="The property that decides the split of an episode.",
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
    callback=_fractions,
    metavar="F,F,…",
    help="By episode: the shares of train, validation and test, or of train and test; default 0.8,0.1,0.1.",
)
@click.option("--prefix", metavar="NAME", help="Name the new splits NAME-source, NAME-target, …")
@click.option(
    "--name",
    "names",
    callback=_names,
    multiple=True,
    metavar="SPLIT=NAME",
    help="Name one of the new splits, e.g. --name source=at-50; may be repeated.",
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
def split_command(folder: Path, as_list: bool, **options: Any) -> Result:
    """Split a dataset: label its episodes, or write a copy in which every split has its own files.

    \b
    ibdata split data/random --by setpoint --source 50 --target 70
    ibdata split data/random --by setpoint --scheme leave-one-out --prefix fold
    ibdata split data/many --by episode --fractions 0.7,0.3
    ibdata split data/many --list
    ibdata split data/many --remove test
    ibdata split data/many --materialize data/many-files
    """
    from ibdata.dataset.dataset import Dataset

    if as_list:
        for option, value in options.items():
            if value not in (None, (), {}):
                name = "name" if option == "names" else option
                raise click.UsageError(f"--list changes nothing, but found --{name} too; give one of them")
        return Splits(Dataset(folder))
    from ibdata.maintenance.split import split

    before = {} if options["materialize"] else Dataset(folder).stored.splits
    return Splits(split(folder, **options), before)
