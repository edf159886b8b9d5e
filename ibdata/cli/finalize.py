from pathlib import Path

import click

from ibdata.cli._options import folder_argument
from ibdata.cli._printing import Printed, made, prints_result


@click.command("finalize")
@folder_argument
@prints_result
def command(folder: Path) -> Printed:
    """Complete a dataset whose parts were made by `ibdata generate --shards`.

    Every shard is checked first. If some are missing, the error names them and the command that makes them.

    \b
    ibdata generate random.yaml --out data/random --shards 1/2
    ibdata generate random.yaml --out data/random --shards 2/2
    ibdata finalize data/random
    """
    from ibdata.generation.generate import finalize

    return made(finalize(folder))
