"""The size and duration of a run, estimated from a small sample of it."""

from __future__ import annotations

import io
import os
import time
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from ibdata.arguments import public
from ibdata.dataset.tabular import Table, Tabular, pairs
from ibdata.experiment import KEYS, Config, Experiment, Overrides, load_all
from ibdata.experiment.code import require_consent
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard, plan
from ibdata.experiment.rollout import rollout
from ibdata.generation.engine import refuse_workers
from ibdata.generation.generate import is_folder, places_of
from ibdata.generation.run import already_there, refuse_both
from ibdata.generation.target import TakenError
from ibdata.generation.upload import refuse_overwrite
from ibdata.generation.warm_up import warm_up
from ibdata.generation.worker import process_for
from ibdata.generation.workers import divide
from ibdata.numerics.naming import counted, size
from ibdata.system.files import HashingFile
from ibdata.system.part import resolved
from ibdata.system.processes import available_processors
from ibdata.writing.shard_writer import encode
from ibdata.writing.summary import describe

SAMPLE_ROWS = 100_000
PARTS = 8


class Estimate(Tabular, dict[str, Any]):
    """The size and duration of a run: a dict that shows as a table."""

    def tables(self) -> list[Table]:
        """The names and values, a row for each experiment."""
        rows = self.get("experiments", [self])
        return [Table(list(rows[0]), [list(row.values()) for row in rows])]

    def plain(self) -> dict[str, Any]:
        """The names and values."""
        return self

    def __repr__(self) -> str:
        lines = [
            f"{run['out']}: {counted(run['rows'], 'row')}, {size(run['bytes'])}, {run['seconds']:.1f} s"
            for run in self.get("experiments", [])
        ]
        workers = counted(self["workers"], "worker")
        total = [
            ("out", f"{self['out']} (nothing is written)"),
            *((name, f"{self[name]:,}") for name in ("episodes", "rows", "shards")),
            ("bytes", f"{self['bytes']:,} ({size(self['bytes'])}, estimated from a sample)"),
            ("seconds", f"{self['seconds']:,.1f} with {workers} (estimated from a sample)"),
        ]
        return "\n".join([*lines, *([""] if lines else []), pairs(total)])


@partial(public, keys=KEYS)
def estimate(
    config: Config,
    out: str | os.PathLike[str] | None = None,
    *,
    workers: int | None = None,
    seed: int | None = None,
    overrides: Overrides = (),
    resume: bool = False,
    overwrite: bool = False,
    allow_code: bool = False,
) -> Estimate:
    """Estimate the size and duration of what `generate` would do from a small sample; nothing is written.

    Args:
        config: This and the other arguments are as in `generate`.
        out: As in `generate`.
        workers: As in `generate`.
        seed: As in `generate`.
        overrides: As in `generate`.
        resume: As in `generate`.
        overwrite: As in `generate`.
        allow_code: As in `generate`.

    Returns:
        name, out, episodes, rows, shards, workers (the number of processes), and estimated bytes and seconds.
        Of a folder of experiments, the sums, and `experiments`, a list of such dicts.

    Raises:
        IbdataError: As in `generate`.
    """
    refuse_workers(workers)
    refuse_both(resume, overwrite)
    experiments = load_all(config, overrides, seed)
    for experiment in experiments:
        require_consent(DatasetSpec.of(experiment), experiment.name, allow_code)
    runs = []
    for experiment, place in zip(experiments, places_of(config, experiments, out), strict=True):
        _refuse_place(experiment, place, resume, overwrite)
        runs.append(_estimate(experiment, place, workers))
    if not is_folder(config):
        return runs[0]
    total = {key: sum(run[key] for run in runs) for key in ("episodes", "rows", "shards", "bytes", "seconds")}
    folder = str(Path(runs[0]["out"]).parent)
    return Estimate(
        {"out": folder, **total, "workers": max(run["workers"] for run in runs), "experiments": runs}
    )


def _refuse_place(experiment: Experiment, place: Path | str, resume: bool, overwrite: bool) -> None:
    """Raise what `generate` would raise at a place that holds neither a dataset nor a run."""
    if isinstance(place, str):
        refuse_overwrite(place, overwrite)
        return
    with suppress(TakenError):
        already_there(experiment, resolved(place), place, resume, overwrite)


def _estimate(planned: Experiment, place: Path | str, workers: int | None) -> Estimate:
    spec = DatasetSpec.of(planned)
    with process_for(spec) as process:
        size, seconds = process.call(_sample)
    shards = plan(planned)
    division = divide(spec, shards, workers)
    busy = min(division.processes * division.threads, len(shards), available_processors())
    return Estimate(
        name=planned.name,
        out=str(place),
        episodes=len(planned.cells) * planned.episodes,
        rows=planned.rows,
        shards=len(shards),
        bytes=round(size * planned.rows),
        seconds=seconds * planned.rows / busy,
        workers=division.processes,
    )


def _sample(spec: DatasetSpec) -> tuple[float, float]:
    """Measure bytes and seconds per row on parts that are spread evenly over the cells."""
    [experiment] = spec.experiments
    warm_up(experiment)
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
