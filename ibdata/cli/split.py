"""ibdata split."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._shared import folder_argument, json_option, print_json, say

SCHEMES = ("transfer", "leave-one-out", "interpolation", "extrapolation", "distance")


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


@click.command("split")
@folder_argument
@click.option(
    "--by",
    type=click.Choice(["setpoint", "episode", "policy"]),
    help="The property that decides the split of an episode.",
)
@click.option(
    "--scheme",
    type=click.Choice(SCHEMES),
    default="transfer",
    show_default=True,
    help="With --by setpoint: how to split the setpoints.",
)
@click.option("--source", type=float, multiple=True, metavar="P", help="A source setpoint; may be repeated.")
@click.option("--target", type=float, multiple=True, metavar="P", help="A target setpoint; may be repeated.")
@click.option("--shots", type=int, metavar="N", help="Episodes per policy and target setpoint; default: all.")
@click.option("--transitions", type=int, metavar="N", help="As --shots, but as a number of rows.")
@click.option(
    "--within",
    type=float,
    metavar="D",
    help="With --scheme distance: the largest distance of a near setpoint from the source.",
)
@click.option(
    "--fractions",
    type=Fractions(),
    default="0.8,0.1,0.1",
    show_default=True,
    help="With --by episode: the shares of train, validation and test, or of train and test.",
)
@click.option(
    "--materialize",
    type=click.Path(path_type=Path),
    metavar="OUT",
    help="Write a copy to OUT in which each split has its own files.",
)
@json_option
def command(
    folder: Path,
    by: str | None,
    scheme: str,
    source: tuple[float, ...],
    target: tuple[float, ...],
    shots: int | None,
    transitions: int | None,
    within: float | None,
    fractions: tuple[float, ...],
    materialize: Path | None,
    as_json: bool,
) -> None:
    """Split a dataset: label its episodes, or write a copy in which every split has its own files.

    \b
    ibdata split data/random --by setpoint --source 50 --target 70
    ibdata split data/random --by setpoint --scheme leave-one-out
    ibdata split data/many --by episode --fractions 0.7,0.3
    ibdata split data/many --materialize data/many-files
    """
    from ibdata.maintenance.split import split

    dataset = split(
        folder,
        by,
        scheme=scheme,
        source=source,
        target=target,
        shots=shots,
        transitions=transitions,
        within=within,
        fractions=fractions,
        materialize=materialize,
    )
    splits = dataset.info["splits"]
    if as_json:
        print_json({"path": str(dataset.path), "splits": splits, "content_root": dataset.content_root})
        return
    width = max(map(len, splits), default=0)
    for name, made in splits.items():
        kind = "labels" if made["files"] is None else "whole files"
        say(f"{name.ljust(width)}  {made['rows']} rows in {made['episodes']} episodes ({kind})")
