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
    from ibdata.dataset import manifest
    from ibdata.maintenance.card import card

    dataset = card(folder)
    files = [name for name in (manifest.CARD, manifest.REPORT) if name in dataset.manifest_model.entries()]
    if as_json:
        print_json({"path": str(folder), "files": files, "content_root": dataset.content_root})
        return
    for name in files:
        say(folder / name)
