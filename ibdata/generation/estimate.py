"""The size and duration of a run, estimated from a small sample of it."""

from __future__ import annotations

import io
import os
import time
from pathlib import Path
from typing import Any

from ibdata.dataset.tabular import Table, Tabular
from ibdata.errors import UsageError
from ibdata.experiment import Config, Experiment, Overrides, load
from ibdata.experiment.custom_code import require_consent
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fresh_modules import in_one_folder
from ibdata.experiment.plan import Shard, plan
from ibdata.generation import origin
from ibdata.generation.engine import refuse_workers
from ibdata.generation.generate import already_there, default_folder, unfinished
from ibdata.generation.target import TakenError, is_free
from ibdata.generation.warm_up import warm_up
from ibdata.generation.workers import divide
from ibdata.simulation.rollout import rollout
from ibdata.system.files import HashingFile
from ibdata.system.part import Part, resolved
from ibdata.system.processes import available_processors
from ibdata.writing.shard_writer import encode
from ibdata.writing.summary import describe

SAMPLE_ROWS = 100_000
PARTS = 8


class Estimate(Tabular, dict[str, Any]):
    """The size and duration of a run: a dict that shows as a table."""

    def tables(self) -> list[Table]:
        """The names and values, a row of all of them."""
        return [Table(list(self), [list(self.values())])]


def estimate(
    experiment: Config,
    folder: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    allow_code: bool = False,
    *,
    overrides: Overrides = (),
    seed: int | None = None,
) -> Estimate:
    """Estimate the size and duration of a run from a small sample of it; nothing is written.

    Args:
        experiment: The experiment, as `config` of `generate`.
        folder: The folder in which it would be generated; by default data/<name>.
        workers: How many processes would be used; by default chosen by the work.
        resume: As in `generate`.
        overwrite: As in `generate`.
        allow_code: As in `generate`.
        overrides: As in `generate`.
        seed: As in `generate`.

    Returns:
        out, episodes, rows, shards, workers (the number of processes), and estimated bytes and seconds; a
        dict that notebooks show as a table.

    Raises:
        IbdataError: As in `generate`.
    """
    planned, out = _permitted(load(experiment, overrides, seed), folder, workers, allow_code)
    outlook(planned, out, resume, overwrite)
    return _estimate(planned, out, workers)


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
    planned, out = _permitted(load(experiment), folder, workers, allow_code)
    try:
        found = outlook(planned, out, resume, overwrite)
    except TakenError as error:
        found = f"generate would stop with: {error.with_options}"
    return {**_estimate(planned, out, workers), "folder": found}


def _permitted(
    planned: Experiment, folder: str | os.PathLike[str] | None, workers: int | None, allow_code: bool
) -> tuple[Experiment, Path]:
    """The experiment and its folder. Raises IbdataError if nothing can be estimated now."""
    refuse_workers(workers)
    require_consent(DatasetSpec.of(planned), planned.name, allow_code)
    return planned, default_folder(planned) if folder is None else Path(folder)


def outlook(planned: Experiment, out: Path, resume: bool, overwrite: bool) -> str | None:
    """What `generate` would do with what is at a place; None if there is nothing. Raises what it raises."""
    if resume and overwrite:
        raise UsageError("--resume and --overwrite exclude each other; give one of them")
    target = resolved(out)
    if already_there(planned, target, out, resume, overwrite):
        return "exists; generate would find the dataset finished, and write nothing"
    part = Part(target)
    if part.receipts:
        same = origin.same_experiment(part.folder, planned)
        if not overwrite and not (same and resume):
            raise unfinished(out, None if same else "of another experiment", resume)
        return f"generate would {'go on with' if same else 'discard'} the unfinished run in it"
    if not is_free(target, out):
        return "exists; generate would replace the dataset in it"
    return None


def _estimate(planned: Experiment, out: Path, workers: int | None) -> Estimate:
    spec = DatasetSpec.of(planned)
    with in_one_folder(spec):
        warm_up(planned)
        size, seconds = _sample(planned)
    shards = plan(planned)
    division = divide(spec, shards, workers)
    busy = min(division.processes * division.threads, len(shards), available_processors())
    return Estimate(
        out=str(out),
        episodes=len(planned.cells) * planned.episodes,
        rows=planned.rows,
        shards=len(shards),
        bytes=round(size * planned.rows),
        seconds=seconds * planned.rows / busy,
        workers=division.processes,
    )


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
