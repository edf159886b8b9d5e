"""ibdata repair."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._shared import allow_code_option, folder_argument, json_option, print_json, say
from ibdata.numerics.naming import counted


@click.command("repair")
@folder_argument
@click.option("--workers", type=int, metavar="N", help="Worker processes; default: chosen by the work.")
@allow_code_option
@json_option
def command(folder: Path, workers: int | None, allow_code: bool, as_json: bool) -> None:
    """Make damaged or missing files of a dataset again.

    No other file is touched. A file is replaced only by one with the content that the manifest lists.

    \b
    ibdata repair data/random
    """
    from ibdata.dataset import manifest
    from ibdata.dataset.reader import Dataset
    from ibdata.maintenance.repair import repair

    repaired = repair(folder, workers, allow_code)
    root = Dataset(folder).content_root
    if as_json:
        print_json({"path": str(folder), "repaired": repaired, "content_root": root})
        return
    for path in repaired:
        removed = path == manifest.REPORT
        say(f"removed {path}; ibdata card {folder} makes it again" if removed else f"repaired {path}")
    say(f"{folder}: {counted(len(repaired), 'file')} repaired, content root {root}")
