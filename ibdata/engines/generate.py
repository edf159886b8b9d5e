"""Generating a dataset: plan, refuse or clear the folder, run the shards, finish."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from ibdata.dataset.finish import FILES, finish
from ibdata.dataset.reader import Dataset
from ibdata.dataset.shard import Written
from ibdata.engines import local, target
from ibdata.engines.warmup import warm_up
from ibdata.errors import IbdataError, UsageError
from ibdata.experiment import Experiment, load
from ibdata.experiment.plan import Shard, plan

MAX_WORKERS = 1024


def generate(
    config: str | os.PathLike[str] | Experiment,
    out: str | os.PathLike[str] | None = None,
    *,
    workers: int | None = None,
    seed: int | None = None,
    overrides: Sequence[str] = (),
    overwrite: bool = False,
    progress: bool | None = False,
) -> Dataset:
    """Make the dataset of an experiment and open it.

    config is a YAML file, the name of a shipped one, or an Experiment; out defaults to data/<name>,
    workers to the number of processors; overrides are `key.sub=value`. The content does not depend on the
    workers. progress None shows a bar on stderr if that is a terminal. A script that uses several workers
    needs multiprocessing's `if __name__ == "__main__":`.

    Raises ConfigError for an experiment that is not valid, UsageError for a folder that holds something
    else (overwrite replaces datasets of ibdata only), IbdataError where the system refuses.
    """
    experiment = resolve(config, overrides, seed)
    processes = worker_count(workers)
    folder = Path(out) if out is not None else default_folder(experiment)
    target.check(folder, overwrite)
    warm_up(experiment)
    shards = plan(experiment)
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        target.clear(folder)
        written = _run(experiment, shards, folder, processes, progress)
        finish(experiment, written, folder)
    except BaseException as error:
        target.remove(folder, [*FILES, *(shard.file for shard in shards)])
        for path in missing:
            if path.is_dir() and not any(path.iterdir()):
                path.rmdir()
        if isinstance(error, OSError):
            raise IbdataError(f"{folder}: cannot be written: {error.strerror or error}") from error
        raise
    return Dataset(folder)


def resolve(
    config: str | os.PathLike[str] | Experiment, overrides: Sequence[str] = (), seed: int | None = None
) -> Experiment:
    """The experiment meant; overrides go with a file or name only."""
    if not isinstance(config, Experiment):
        return load(config, overrides, seed)
    if overrides:
        raise UsageError("overrides: found an Experiment as config, expected a file or a name with them")
    return config if seed is None else Experiment.model_validate({**config.plain(), "seed": seed})


def worker_count(workers: int | None) -> int:
    """The number of processes to use: as asked for, or one a processor."""
    if workers is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not 1 <= workers <= MAX_WORKERS:
        raise UsageError(f"workers: found {workers}, expected a whole number in [1, {MAX_WORKERS}]")
    return workers


def default_folder(experiment: Experiment) -> Path:
    """data/<name> in the current folder."""
    return Path("data") / experiment.name


def _run(
    experiment: Experiment, shards: list[Shard], folder: Path, workers: int, progress: bool | None
) -> list[Written]:
    disable = None if progress is None else not progress
    written = []
    with tqdm(total=experiment.rows, unit=" transitions", unit_scale=True, disable=disable) as bar:
        for w in local.run(experiment, shards, folder, workers):
            written.append(w)
            bar.update((w.shard.stop - w.shard.first) * experiment.steps)
    return written
