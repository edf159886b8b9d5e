"""ibdata ls."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ibdata.cli._shared import LocalPath, json_option, print_json, print_table, say, size
from ibdata.numerics.naming import counted, exact

if TYPE_CHECKING:
    from ibdata.maintenance.listing import Listed

MOST = 3  # setpoints or policies that are named


@click.command("ls")
@click.argument("folder", metavar="[FOLDER]", default=".", type=LocalPath())
@json_option
def command(folder: Path, as_json: bool) -> None:
    """List the datasets in a folder and in the folders below it.

    FOLDER is the current folder by default. A dataset is finished, unfinished (generate --resume goes on) or
    damaged (ibdata validate says how).

    \b
    ibdata ls
    ibdata ls data/siemens-offline
    """
    from ibdata.maintenance.listing import datasets_in

    found = datasets_in(folder)
    if as_json:
        print_json({"datasets": [each.plain() for each in found]})
        return
    if not found:
        say(f"{folder}: no datasets here or below; ibdata generate random.yaml makes one")
        return
    print_table(
        ("dataset", "rows", "bytes", "setpoints", "policies", "content", "state"), list(map(_row, found))
    )
    parents = dict.fromkeys(each.path.parent for each in found)
    below = {parent: [each for each in found if each.path.is_relative_to(parent)] for parent in parents}
    if len(found) > max(map(len, below.values())):
        below[folder] = found
    for parent, own in below.items():
        if len(own) > 1:
            rows, data_bytes = sum(each.rows or 0 for each in own), sum(each.bytes for each in own)
            say(f"{parent}: {counted(len(own), 'dataset')}, {counted(rows, 'row')}, {size(data_bytes)}")


def _row(each: Listed) -> tuple[str, ...]:
    return (
        str(each.path),
        "-" if each.rows is None else f"{each.rows:,}",
        size(each.bytes),
        _some([exact(p) for p in each.setpoints]),
        _some(each.policies),
        "-" if each.content_root is None else each.content_root[:8],
        each.state,
    )


def _some(names: Sequence[str]) -> str:
    if len(names) > MOST:
        return f"{names[0]} … {names[-1]} ({len(names):,})"
    return ", ".join(names) or "-"
