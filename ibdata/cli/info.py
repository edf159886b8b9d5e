"""ibdata info."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._shared import folder_argument, json_option, print_json, print_pairs, size


@click.command("info")
@folder_argument
@json_option
def command(folder: Path, as_json: bool) -> None:
    """Say what a dataset holds.

    \b
    ibdata info data/random
    """
    from ibdata.dataset.reader import Dataset

    dataset = Dataset(folder)
    info, counts = dataset.info, dataset.info["counts"]
    if as_json:
        print_json({"path": str(folder), "content_root": dataset.content_root, "info": info})
        return
    pairs = [
        ("name", info["name"]),
        ("dynamics", info["dynamics"]),
        ("rows", f"{counts['rows']} in {counts['episodes']} episodes of {counts['steps']} steps"),
        ("files", f"{counts['shards']} Parquet, {size(counts['data_bytes'])}"),
        ("content root", dataset.content_root),
    ]
    for name, split in info["splits"].items():
        pairs.append((f"split {name}", f"{split['rows']} rows in {split['episodes']} episodes"))
    for role, names in info["groups"].items():
        pairs.append((role, ", ".join(names)))
    print_pairs(pairs)
