from pathlib import Path

import click

from ibdata.cli._options import allow_code_option, folder_argument, workers_option
from ibdata.cli._printing import Printed, prints_result
from ibdata.numerics.naming import counted


@click.command("repair")
@folder_argument
@workers_option
@allow_code_option
@prints_result
def command(folder: Path, workers: int | None, allow_code: bool) -> Printed:
    """Make damaged or missing files of a dataset again.

    No other file is touched. A file is replaced only by one with the content that the manifest lists.

    \b
    ibdata repair data/random
    """
    from ibdata.dataset.reader import Dataset
    from ibdata.maintenance.repair import repair

    repaired = repair(folder, workers, allow_code)
    root = Dataset(folder).content_root
    lines = [f"repaired {path}" for path in repaired]
    lines.append(f"{folder}: {counted(len(repaired), 'file')} repaired, content root {root}")
    return Printed({"path": str(folder), "repaired": repaired, "content_root": root}, "\n".join(lines))
