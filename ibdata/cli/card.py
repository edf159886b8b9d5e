from pathlib import Path

import click

from ibdata.cli._options import folder_argument
from ibdata.cli._printing import Printed, lines, prints_result


@click.command("card")
@folder_argument
@prints_result
def command(folder: Path) -> Printed:
    """Write a dataset's card (README.md) and its report (report.html).

    The report shows pictures, returns, statistics, experiment and provenance in one file, which needs no
    network. Without matplotlib only the card is written.

    \b
    ibdata card data/random
    """
    from ibdata.maintenance.card import card

    written = card(folder)
    files = [path.name for path in written]
    return Printed({"path": str(folder), "files": files}, lines(written))
