"""ibdata card."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._shared import folder_argument, json_option, print_json, say


@click.command("card")
@folder_argument
@json_option
def command(folder: Path, as_json: bool) -> None:
    """Write a dataset's card (README.md) and its report (report.html).

    The report shows pictures, returns, statistics, experiment and provenance in one file, which needs no
    network. Without matplotlib only the card is written.

    \b
    ibdata card data/random
    """
    from ibdata.maintenance.card import card

    written = card(folder)
    if as_json:
        print_json({"path": str(folder), "files": [path.name for path in written]})
        return
    for path in written:
        say(path)
