from pathlib import Path

import click

from ibdata.cli._options import LOCAL
from ibdata.cli._printing import Printed, prints_result


@click.command("init")
@click.argument("file", metavar="[FILE]", default="experiment.yaml", type=LOCAL)
@prints_result
def command(file: Path) -> Printed:
    """Write an example experiment with comments, for you to edit.

    FILE is experiment.yaml by default; an existing file is not changed.

    \b
    ibdata init
    ibdata init mine.yaml
    """
    from ibdata.experiment.template import write_template

    write_template(file)
    return Printed({"file": str(file)}, f"{file}: edit it, then run ibdata generate {file} --dry-run")
