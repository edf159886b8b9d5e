"""ibdata diff."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._shared import LocalPath, json_option, print_json, say


@click.command("diff")
@click.argument("first", metavar="A", type=LocalPath())
@click.argument("second", metavar="B", type=LocalPath())
@json_option
def command(first: Path, second: Path, as_json: bool) -> None:
    """Print how two datasets differ.

    Compares experiments, columns and counts, and finds the first episode, step and column that differ. The
    exit code is 3 if the datasets differ, and 2 if A or B is not a dataset.

    \b
    ibdata diff data/random data/random-paper
    """
    from ibdata.dataset.difference import difference
    from ibdata.dataset.manifest import NoDatasetError
    from ibdata.dataset.reader import Dataset
    from ibdata.errors import UsageError

    try:
        datasets = Dataset(first), Dataset(second)
    except NoDatasetError as error:
        raise UsageError(str(error)) from None
    lines = difference(*datasets)
    if as_json:
        print_json({"same": not lines, "differences": lines})
    else:
        for line in lines or ["the same content"]:
            say(line)
    if lines:
        raise SystemExit(3)
