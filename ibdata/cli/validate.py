"""ibdata validate."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._shared import (
    json_option,
    place_argument,
    print_json,
    problems_json,
    quiet_option,
    report_problems,
)


@click.command("validate")
@place_argument
@click.option("--quick", is_flag=True, help="Check only the hashes of the files.")
@quiet_option
@json_option
def command(folder: Path | str, quick: bool, quiet: bool, as_json: bool) -> None:
    """Check every file and every row of a dataset.

    Prints each problem with file, row and rule, and with what was found and expected; the exit code is 3 if
    there are any.

    \b
    ibdata validate data/random
    ibdata validate data/random --quick
    """
    from ibdata.validation.validate import validate

    problems = validate(folder, quick, progress=False if quiet else None)
    if as_json:
        print_json({"path": str(folder), "valid": not problems, "problems": problems_json(problems)})
    report_problems(problems, f"{folder}: valid" + (" (hashes only)" if quick else ""), as_json)
