from pathlib import Path

import click

from ibdata.cli._options import LOCAL
from ibdata.cli._printing import Printed, lines, prints_result


@click.command("diff")
@click.argument("first", metavar="A", type=LOCAL)
@click.argument("second", metavar="B", type=LOCAL)
@prints_result
def command(first: Path, second: Path) -> Printed:
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
    found = difference(*datasets)
    text = lines(found or ["the same content"])
    return Printed({"same": not found, "differences": found}, text, exit_code=3 if found else 0)
