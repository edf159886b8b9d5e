from pathlib import Path

import click

from ibdata.cli._options import place_argument, progress_option
from ibdata.cli._printing import Printed, prints_result, problems_found


@click.command("validate")
@place_argument
@click.option("--quick", is_flag=True, help="Check only the hashes of the files.")
@progress_option
@prints_result
def command(folder: Path | str, quick: bool, progress: bool | None) -> Printed:
    """Check every file and every row of a dataset.

    Prints each problem with file, row and rule, and with what was found and expected; the exit code is 3 if
    there are any.

    \b
    ibdata validate data/random
    ibdata validate data/random --quick
    """
    from ibdata.validation.validate import validate

    problems = validate(folder, quick, progress=progress)
    fine = f"{folder}: valid" + (" (hashes only)" if quick else "")
    return problems_found(problems, {"path": str(folder), "valid": not problems}, fine)
