"""ibdata export."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ibdata.cli._options import (
    LOCAL,
    Listing,
    folder_argument,
    progress_option,
    split_option,
    summaries,
)
from ibdata.cli._printing import Printed, pairs, prints_result, within
from ibdata.cli._views import view_of, view_options
from ibdata.exporters import FORMATS, added_formats
from ibdata.numerics.naming import counted


def _formats() -> list[tuple[str, str]]:
    added = [(each.name, f"Added by {each.module}.") for each in added_formats()]
    return summaries("ibdata.exporters", FORMATS) + added


@click.command("export", cls=Listing, title="Formats", listed=_formats)
@folder_argument
@click.option(
    "--to",
    required=True,
    type=click.Choice([*FORMATS, *sorted(added_formats().names)]),
    help="The format; see below.",
)
@click.option("--out", required=True, type=LOCAL, metavar="PATH", help="The file or folder to write.")
@split_option
@click.option(
    "--history",
    type=int,
    metavar="N",
    help="Observations to stack, newest first; default 1, or 30 for neorl.",
)
@view_options
@click.option("--id", metavar="ID", help="For minari: NAMESPACE/NAME-vN; default ibdata/<name>-v0.")
@click.option("--overwrite", is_flag=True, help="Replace an export that is there.")
@progress_option
@prints_result
def command(
    folder: Path,
    to: str,
    out: Path,
    observe: str,
    actions: bool,
    reward: str,
    reward_scale: float,
    imperfections: str | None,
    **options: Any,
) -> Printed:
    """Write a dataset in the format of another library, and print the Python code that loads it.

    Every transition is kept, including the last of each episode with its next observation. (Only if --observe
    names hidden columns, and the dataset does not have them after the last row, is that row left out, and the
    output says so.) Floats become float32, except in csv. The output appears only when it is complete.

    \b
    ibdata export data/random --to minari --out minari-datasets
    ibdata export data/transfer --to npz --out t.npz --split target --history 10
    ibdata export data/random --to csv --out m.csv --observe markov --reward delta
    """
    from ibdata.exporters import export

    view = view_of(observe, actions, reward, reward_scale, imperfections)
    exported = export(folder, to, out, **options, view=view)
    lines: list[tuple[str, object]] = [
        ("export", exported.path),
        ("rows", within(exported.rows, exported.episodes)),
        ("format", exported.format),
    ]
    if exported.left_out:
        why = "the last of each episode; generate with output: {latent: next} to keep them"
        lines.append(("left out", f"{counted(exported.left_out, 'row')}, {why}"))
    return Printed(exported._asdict(), f"{pairs(lines)}\n\n{exported.snippet}")
