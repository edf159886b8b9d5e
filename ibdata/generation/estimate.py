"""The size and duration of a run, estimated from a small sample of it."""

from __future__ import annotations

import io
import os
import time
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
from ibdata.generation.generate import is_folder, places_of
from ibdata.generation.process import process_for
from ibdata.generation.record import warm_up
from ibdata.generation.target import Mode, TakenError, Target, decide, look
from ibdata.generation.upload import refuse_overwrite
from ibdata.generation.workers import divide, refuse_workers
from ibdata.numerics.naming import counted, size
from ibdata.system.files import HashingFile
from ibdata.system.processes import available_processors
from ibdata.writing.columns import ROW_GROUP_ROWS, Piece
from ibdata.writing.shard import describe, parquet_writer

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
        if self.get("action"):
            total.append(("action", self["action"]))
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
        name, out, episodes, rows, shards, workers (the number of processes), estimated bytes and seconds, and
        `action`: what `generate` would do with what is at `out`, or None; a URL is not looked at. Of a folder
        of experiments, the sums, and `experiments`, a list of such dicts.

    Raises:
        IbdataError: As in `generate`.
    """
    refuse_workers(workers)
    mode = Mode.of(resume, overwrite)
    experiments = load_all(config, overrides, seed)
    for experiment in experiments:
        require_consent(DatasetSpec.of(experiment), experiment.name, allow_code)
    runs = [
        Estimate(_estimate(experiment, place, workers), action=_action(experiment, place, mode))
        for experiment, place in zip(experiments, places_of(config, experiments, out), strict=True)
    ]
    if not is_folder(config):
        return runs[0]
    total = {key: sum(run[key] for run in runs) for key in ("episodes", "rows", "shards", "bytes", "seconds")}
    folder = str(Path(runs[0]["out"]).parent)
    return Estimate(
        {"out": folder, **total, "workers": max(run["workers"] for run in runs), "experiments": runs}
    )


def _action(experiment: Experiment, place: Path | str, mode: Mode) -> str | None:
    """What `generate` would do at a place; None at a URL, which is not looked at."""
    if isinstance(place, str):
        refuse_overwrite(place, mode)
        return None
    target = Target(place)
    try:
        return decide(look(target, DatasetSpec.of(experiment), with_part=True), mode).value
    except TakenError as error:
        return f"stop: {error}"


def _estimate(planned: Experiment, place: Path | str, workers: int | None) -> dict[str, Any]:
    spec = DatasetSpec.of(planned)
    with process_for(spec) as process:
        bytes_per_row, seconds = process.call(_sample)
    shards = plan(planned)
    division = divide(spec, shards, workers)
    busy = min(division.processes * division.threads, len(shards), available_processors())
    return dict(
        name=planned.name,
        out=str(place),
        episodes=planned.episode_count,
        rows=planned.rows,
        shards=len(shards),
        bytes=round(bytes_per_row * planned.rows),
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
        piece = Piece(small, shard, rollout(small, shard.first, shard.stop))
        with parquet_writer(small, file) as parquet:
            parquet.write_table(piece.arrow_table(), row_group_size=ROW_GROUP_ROWS)
        describe(DatasetSpec.of(small), shard, [piece])
        size += file.size
    rows = parts * width * steps
    return size / rows, (time.perf_counter() - start) / rows
