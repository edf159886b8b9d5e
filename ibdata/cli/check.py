"""Commands that check datasets: validate, repair, reproduce."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ibdata._numerics.naming import counted
from ibdata.cli._options import (
    allow_code_option,
    folder_argument,
    place_argument,
    progress_option,
    workers_option,
)
from ibdata.cli._printing import Printed, prints_result

if TYPE_CHECKING:
    from ibdata.tools.rules import Problem


def checked(problems: Sequence[Problem], fine: str, **data: Any) -> Printed:
    """The result of a check: a line if all is well, else the problems."""
    data["problems"] = [problem._asdict() for problem in problems]
    return Printed(data, "" if problems else fine, problems)


@click.command("validate")
@place_argument
@click.option("--quick", is_flag=True, help="Check only the hashes of the files, and the splits.")
@progress_option
@prints_result
def validate_command(folder: Path | str, quick: bool, progress: bool | None) -> Printed:
    """Check every file and every row of a dataset.

    Prints each problem with file, row and rule, and with what was found and expected; the exit code is 3 if
    there are any.

    \b
    ibdata validate data/random
    ibdata validate data/random --quick
    """
    from ibdata._system.storage import existing
    from ibdata.tools.validate import validate

    place = existing(folder)
    problems = validate(place, quick, progress=progress)
    fine = f"{place}: valid" + (" (hashes only)" if quick else "")
    return checked(problems, fine, path=str(place), valid=not problems)


@click.command("repair")
@folder_argument
@workers_option
@allow_code_option
@prints_result
def repair_command(folder: Path, workers: int | None, allow_code: bool) -> Printed:
    """Make damaged or missing files of a dataset again.

    No other file is touched. A file is replaced only by one with the content that the manifest lists.

    \b
    ibdata repair data/random
    """
    from ibdata.dataset.dataset import Dataset
    from ibdata.tools.repair import repair

    repaired = repair(folder, workers, allow_code)
    root = Dataset(folder).content_root
    lines = [f"repaired {path}" for path in repaired]
    lines.append(f"{folder}: {counted(len(repaired), 'file')} repaired, content root {root}")
    return Printed({"path": str(folder), "repaired": repaired, "content_root": root}, "\n".join(lines))


@click.command("reproduce")
@folder_argument
@click.option("--episodes", type=int, metavar="N", help="Compare N evenly spread episodes; default: all.")
@allow_code_option
@prints_result
def reproduce_command(folder: Path, episodes: int | None, allow_code: bool) -> Printed:
    """Generate a dataset again in memory and compare it with the stored one.

    Prints the episodes that differ; the exit code is 3 if there are any. Nothing is written.

    \b
    ibdata reproduce data/random
    ibdata reproduce data/random --episodes 3
    """
    from ibdata._system.storage import existing
    from ibdata.tools.reproduce import reproduce

    place = existing(folder)
    count, problems = reproduce(place, episodes, allow_code)
    fine = f"{place}: {counted(count, 'episode')} made again, all the same"
    return checked(problems, fine, path=str(place), episodes=count, same=not problems)
