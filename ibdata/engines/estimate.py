"""What a run would make, measured on a small sample of it; nothing is written."""

from __future__ import annotations

import io
import time
from pathlib import Path
from typing import Any

from ibdata.dataset.files import HashingFile
from ibdata.dataset.shard import describe, encode
from ibdata.engines import target
from ibdata.engines.generate import worker_count
from ibdata.engines.warmup import warm_up
from ibdata.experiment import Experiment
from ibdata.experiment.plan import Shard, plan
from ibdata.rollout import rollout

SAMPLE_ROWS = 100_000


def estimate(
    experiment: Experiment,
    folder: Path,
    workers: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Episodes, rows, shards, and estimated bytes and seconds of a run. Raises what `generate` would."""
    processes = worker_count(workers)
    target.check(folder, experiment, resume, overwrite)
    warm_up(experiment)
    shards = plan(experiment)
    busy = min(processes, len(shards))
    size, seconds = _sample(experiment)
    return {
        "out": str(folder),
        "episodes": len(experiment.cells) * experiment.episodes,
        "rows": experiment.rows,
        "shards": len(shards),
        "bytes": round(size * experiment.rows),
        "seconds": seconds * experiment.rows / busy,
        "workers": busy,
    }


def _sample(experiment: Experiment) -> tuple[float, float]:
    """Bytes and seconds a row, from evenly many steps of the first episodes of some cells."""
    steps = min(experiment.steps, SAMPLE_ROWS)
    episodes = min(len(experiment.cells) * experiment.episodes, SAMPLE_ROWS // steps)
    small = experiment.model_copy(update={"steps": steps})
    shard = Shard(0, 0, episodes, ())
    file = HashingFile(io.BytesIO())
    start = time.perf_counter()
    floats = rollout(small, 0, episodes)
    encode(small, shard, floats, file)
    describe(small, shard, floats)
    rows = steps * episodes
    return file.size / rows, (time.perf_counter() - start) / rows
