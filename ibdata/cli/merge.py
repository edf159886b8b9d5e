"""ibdata merge."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._shared import LocalPath, json_option, print_json, say, within


@click.command("merge")
@click.argument("folders", metavar="DIR…", nargs=-1, required=True, type=LocalPath())
@click.option("--out", required=True, type=LocalPath(), metavar="DIR", help="The folder to make.")
@json_option
def command(folders: tuple[Path, ...], out: Path, as_json: bool) -> None:
    """Merge datasets with the same columns into a new one.

    Datasets that share an episode, or the beginning of one, are refused.

    \b
    ibdata merge data/random data/safe --out data/both
    """
    from ibdata.maintenance.merge import merge

    dataset = merge(folders, out)
    counts = dataset.info["counts"]
    if as_json:
        print_json({"out": str(out), **counts, "content_root": dataset.content_root})
        return
    say(f"{out}: {within(counts['rows'], counts['episodes'])}")
    say(f"content root {dataset.content_root}")
