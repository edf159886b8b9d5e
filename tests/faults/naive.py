"""A naive writer: it skips files that exist, writes in place, and writes the manifest at the end.

It is kept as a control: the tests that kill `ibdata generate` must find torn shards when they kill this.
"""

import json
import sys
from pathlib import Path

from ibdata.experiment import load
from ibdata.experiment.plan import plan
from ibdata.simulation.rollout import rollout
from ibdata.system.files import HashingFile
from ibdata.writing.shard_writer import encode


def write(config: str, out: Path) -> None:
    """The shards of an experiment, and their names."""
    experiment = load(config)
    (out / "data").mkdir(parents=True, exist_ok=True)
    shards = plan(experiment)
    for shard in shards:
        path = out / f"{shard.stem}-00000000.parquet"
        if path.exists():
            continue
        with path.open("wb") as file:
            encode(experiment, shard, rollout(experiment, shard.first, shard.stop), HashingFile(file))
    (out / "manifest.json").write_text(json.dumps([shard.stem for shard in shards]), encoding="utf-8")


if __name__ == "__main__":
    write(sys.argv[1], Path(sys.argv[2]))
