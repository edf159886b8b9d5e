"""ibdata init."""

from __future__ import annotations

from pathlib import Path

import click

from ibdata.cli._shared import LocalPath, json_option, print_json, say


@click.command("init")
@click.argument("file", metavar="[FILE]", default="experiment.yaml", type=LocalPath())
@json_option
def command(file: Path, as_json: bool) -> None:
    """Write an example experiment with comments, for you to edit.

    FILE is experiment.yaml by default; an existing file is not changed.

    \b
    ibdata init
    ibdata init mine.yaml
    """
    from ibdata.experiment.template import write_template

    write_template(file)
    if as_json:
        print_json({"file": str(file)})
        return
    say(f"{file}: edit it, then run ibdata generate {file} --dry-run")
