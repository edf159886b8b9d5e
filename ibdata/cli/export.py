"""ibdata export."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._completion import splits
from ibdata.cli._shared import (
    Listing,
    LocalPath,
    folder_argument,
    json_option,
    print_json,
    print_pairs,
    quiet_option,
    say,
    say_all,
    summaries,
)
from ibdata.cli._views import as_keywords, view_options
from ibdata.exporters import FORMATS, added_formats
from ibdata.numerics.naming import counted


def _left_out(rows: int) -> str:
    why = "the last of each episode; generate with output: {latent: next} to keep them"
    return f"{counted(rows, 'row')}, {why}"


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
@click.option(
    "--out",
    required=True,
    type=LocalPath(),
    metavar="PATH",
    help="The file or folder to write.",
)
@click.option("--split", metavar="NAME", shell_complete=splits, help="Export only this split.")
@click.option(
    "--history",
    type=int,
    metavar="N",
    help="Observations to stack, newest first; default 1, or 30 for neorl.",
)
@click.option("--reward-scale", type=float, default=1.0, metavar="X", help="Multiply rewards by X.")
@view_options
@click.option("--id", metavar="ID", help="For minari: NAMESPACE/NAME-vN; default ibdata/<name>-v0.")
@click.option("--overwrite", is_flag=True, help="Replace an export that is there.")
@quiet_option
@json_option
def command(
    folder: Path,
    to: str,
    out: Path,
    split: str | None,
    history: int | None,
    reward_scale: float,
    observe: str,
    actions: bool,
    reward: str,
    imperfections: str | None,
    id: str | None,
    overwrite: bool,
    quiet: bool,
    as_json: bool,
) -> None:
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

    made = export(
        folder,
        to,
        out,
        split=split,
        history=history,
        reward_scale=reward_scale,
        id=id,
        overwrite=overwrite,
        progress=False if quiet else None,
        **as_keywords(observe, actions, reward, imperfections),
    )
    if as_json:
        print_json(made._asdict())
        return
    print_pairs(
        [
            ("export", made.path),
            ("rows", f"{made.rows:,} in {counted(made.episodes, 'episode')}"),
            ("format", made.format),
            *([("left out", _left_out(made.left_out))] if made.left_out else []),
        ]
    )
    say()
    say_all(made.snippet)
