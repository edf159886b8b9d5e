from pathlib import Path

import click

from ibdata.cli._options import allow_code_option, folder_argument
from ibdata.cli._printing import Printed, prints_result, problems_found
from ibdata.numerics.naming import counted


@click.command("reproduce")
@folder_argument
@click.option("--episodes", type=int, metavar="N", help="Compare N evenly spread episodes; default: all.")
@allow_code_option
@prints_result
def command(folder: Path, episodes: int | None, allow_code: bool) -> Printed:
    """Generate a dataset again in memory and compare it with the stored one.

    Prints the episodes that differ; the exit code is 3 if there are any. Nothing is written.

    \b
    ibdata reproduce data/random
    ibdata reproduce data/random --episodes 3
    """
    from ibdata.maintenance.reproduce import reproduce

    count, problems = reproduce(folder, episodes, allow_code)
    plain = {"path": str(folder), "episodes": count, "same": not problems}
    return problems_found(problems, plain, f"{folder}: {counted(count, 'episode')} made again, all the same")
