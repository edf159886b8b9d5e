"""The size and duration of a run, estimated from a small sample of it."""

from __future__ import annotations

import io
import os
import time
from pathlib import Path
from typing import Any

from ibdata.experiment import Experiment, as_recorded
from ibdata.experiment.custom_code import in_one_folder, require_consent
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard, plan
from ibdata.generation import output_folder
from ibdata.generation.division import available_processors, divide
from ibdata.generation.engine import refuse_workers
from ibdata.generation.warm_up import warm_up
from ibdata.simulation.rollout import rollout
from ibdata.system.atomic_files import HashingFile
from ibdata.system.lock import refuse_busy
from ibdata.writing.shard_writer import encode
from ibdata.writing.summary import describe

SAMPLE_ROWS = 100_000
PARTS = 8


def estimate(
    experiment: Experiment,
    folder: str | os.PathLike[str],
    workers: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    allow_code: bool = False,
) -> dict[str, Any]:
    """Estimate the size and duration of a run from a small sample of it; nothing is written.

    Args:
        experiment: The experiment that would be generated.
        folder: The folder in which it would be generated.
        workers: How many processes would be used; by default chosen by the work.
        resume: As in `generate`.
        overwrite: As in `generate`.
        allow_code: As in `generate`.

    Returns:
        out, episodes, rows, shards, the number of processes, and estimated bytes and seconds.

    Raises:
        IbdataError: As in `generate`.
    """
    experiment = _permitted(experiment, folder, workers, allow_code)
    output_folder.check(Path(folder), experiment, resume, overwrite)
    return _estimate(experiment, folder, workers)


def preview(
    experiment: Experiment,
    folder: str | os.PathLike[str],
    workers: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    allow_code: bool = False,
) -> dict[str, Any]:
    """Estimate a run as `estimate` does, also where its folder exists and needs a decision of the user.

    The result also has `folder`: what `generate` would do with a folder that exists, or None.
    """
    experiment = _permitted(experiment, folder, workers, allow_code)
    found = output_folder.outlook(Path(folder), experiment, resume, overwrite)
    return {**_estimate(experiment, folder, workers), "folder": found}


def _permitted(
    experiment: Experiment, folder: str | os.PathLike[str], workers: int | None, allow_code: bool
) -> Experiment:
    """The experiment as it would be recorded. Raises IbdataError if nothing can be estimated now."""
    refuse_workers(workers)
    experiment = as_recorded(experiment)
    require_consent(DatasetSpec.of(experiment), experiment.name, allow_code)
    refuse_busy(Path(folder))
    return experiment


def _estimate(experiment: Experiment, folder: str | os.PathLike[str], workers: int | None) -> dict[str, Any]:
    spec = DatasetSpec.of(experiment)
    with in_one_folder(spec):
        warm_up(experiment)
        size, seconds = _sample(experiment)
    shards = plan(experiment)
    division = divide(spec, shards, workers)
    busy = min(division.processes * division.threads, len(shards), available_processors())
    return {
        "out": str(folder),
        "episodes": len(experiment.cells) * experiment.episodes,
        "rows": experiment.rows,
        "shards": len(shards),
        "bytes": round(size * experiment.rows),
        "seconds": seconds * experiment.rows / busy,
        "workers": division.processes,
    }


def _sample(experiment: Experiment) -> tuple[float, float]:
    """Measure bytes and seconds per row on parts that are spread evenly over the cells."""
    steps = max(1, min(experiment.steps, max(1000, SAMPLE_ROWS // len(experiment.cells))))
    budget = max(1, SAMPLE_ROWS // steps)
    episodes = min(experiment.episodes, -(-budget // len(experiment.cells)))
    small = experiment.part(steps, episodes)
    total = episodes * len(experiment.cells)
    parts = 1 if total <= budget else min(PARTS, budget)
    width = min(total, budget) // parts
    size, start = 0, time.perf_counter()
    for part in range(parts):
        first = part * (total - width) // max(1, parts - 1)
        shard = Shard(part, first, first + width, ())
        file = HashingFile(io.BytesIO())
        floats = rollout(small, shard.first, shard.stop)
        encode(small, shard, floats, file)
        describe(DatasetSpec.of(small), shard, [(shard, floats)])
        size += file.size
    rows = parts * width * steps
    return size / rows, (time.perf_counter() - start) / rows
