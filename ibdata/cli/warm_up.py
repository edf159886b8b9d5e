"""ibdata warm-up."""

from __future__ import annotations

import click

from ibdata.cli._shared import json_option, print_json, say


@click.command("warm-up")
@json_option
def command(as_json: bool) -> None:
    """Compile the simulator in advance, for CI and container images.

    Otherwise the first command that simulates compiles it. The machine code is kept in $IBDATA_CACHE_DIR, or
    else in ~/.cache/ibdata.

    \b
    ibdata warm-up
    IBDATA_CACHE_DIR=/opt/ibdata-cache ibdata warm-up
    """
    from ibdata.maintenance.compile_all import compile_all

    made = compile_all()
    if as_json:
        print_json({"folder": str(made.folder), "seconds": made.seconds})
        return
    say(f"{made.folder}: all machine code is there ({made.seconds:.1f} s)")
