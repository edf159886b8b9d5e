"""ibdata finalize."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._shared import folder_argument, json_option, print_json, say
from ibdata.numerics.naming import counted


@click.command("finalize")
@folder_argument
@json_option
def command(folder: Path, as_json: bool) -> None:
    """Complete a dataset whose parts were made by `ibdata generate --shards`.

    Every shard is checked first. If some are missing, the error names them and the command that makes them.

    \b
    ibdata generate random.yaml --out data/random --shards 1/2
    ibdata generate random.yaml --out data/random --shards 2/2
    ibdata finalize data/random
    """
    from ibdata.generation.array_job import finalize

    dataset = finalize(folder)
    counts = dataset.info["counts"]
    if as_json:
        print_json({"out": str(folder), **counts, "content_root": dataset.content_root})
        return
    say(f"{folder}: {counted(counts['rows'], 'row')} in {counted(counts['shards'], 'file')}")
    say(f"content root {dataset.content_root}")
