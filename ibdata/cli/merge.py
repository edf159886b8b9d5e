from pathlib import Path

import click

from ibdata.cli._options import LOCAL
from ibdata.cli._printing import Printed, made, prints_result


@click.command("merge")
@click.argument("folders", metavar="DIR…", nargs=-1, required=True, type=LOCAL)
@click.option("--out", required=True, type=LOCAL, metavar="DIR", help="The folder to make.")
@prints_result
def command(folders: tuple[Path, ...], out: Path) -> Printed:
    """Merge datasets with the same columns into a new one.

    Datasets that share an episode, or the beginning of one, are refused.

    \b
    ibdata merge data/random data/safe --out data/both
    """
    from ibdata.maintenance.merge import merge

    return made(merge(folders, out))
