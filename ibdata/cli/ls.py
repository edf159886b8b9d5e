from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ibdata.cli._options import LOCAL
from ibdata.cli._printing import Printed, prints_result, size, table
from ibdata.numerics.naming import counted, exact

if TYPE_CHECKING:
    from ibdata.maintenance.listing import Listed

MOST = 3  # setpoints or policies that are named


@click.command("ls")
@click.argument("folder", metavar="[FOLDER]", default=".", type=LOCAL)
@prints_result
def command(folder: Path) -> Printed:
    """List the datasets in a folder and in the folders below it.

    FOLDER is the current folder by default. By its manifest, a dataset is finished, unfinished (generate
    --resume goes on) or damaged; ibdata validate checks all files.

    \b
    ibdata ls
    ibdata ls data/siemens-offline
    """
    from ibdata.maintenance.listing import datasets_in

    found = datasets_in(folder)
    return Printed({"datasets": [each.plain() for each in found]}, _text(folder, found))


def _text(folder: Path, found: Sequence[Listed]) -> str:
    if not found:
        return f"{folder}: no datasets here or below; ibdata generate random.yaml makes one"
    names = ("dataset", "rows", "bytes", "setpoints", "policies", "content", "state")
    rows, data_bytes = sum(each.rows or 0 for each in found), sum(each.bytes for each in found)
    total = f"{folder}: {counted(len(found), 'dataset')}, {counted(rows, 'row')}, {size(data_bytes)}"
    return f"{table(names, list(map(_row, found)))}\n{total}"


def _row(each: Listed) -> tuple[object, ...]:
    return (
        str(each.path),
        each.rows,
        size(each.bytes),
        _some([exact(p) for p in each.setpoints]),
        _some(each.policies),
        each.content_root[:8] if each.content_root else None,
        each.state,
    )


def _some(names: Sequence[str]) -> str | None:
    if len(names) > MOST:
        return f"{names[0]} … {names[-1]} ({len(names):,})"
    return ", ".join(names) or None
