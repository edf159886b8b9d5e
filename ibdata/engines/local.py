"""Shards on this machine: in this process, or in a pool of fresh ones."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from pathlib import Path
from typing import Any

from ibdata.dataset.shard import Written, write_shard
from ibdata.experiment import Experiment
from ibdata.experiment.plan import Shard


def run(experiment: Experiment, shards: list[Shard], folder: Path, workers: int) -> Iterator[Written]:
    """Write the shards, yielding each when it is on the disk; their order depends on the workers."""
    if workers == 1 or len(shards) == 1:
        for shard in shards:
            yield write_shard(experiment, shard, folder)
        return
    # spawn: a forked child would inherit threads and open files of whoever calls the library
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(
        min(workers, len(shards)), context, initializer=_open, initargs=(experiment.plain(), folder)
    ) as pool:
        waiting = list(shards)
        running = {pool.submit(_write, waiting.pop(0)) for _ in range(min(2 * workers, len(waiting)))}
        try:
            while running:
                done, running = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    if waiting:
                        running.add(pool.submit(_write, waiting.pop(0)))
                    yield future.result()
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise


_job: list[Any] = []  # a worker's experiment and folder, set once when it starts


def _open(plain: dict[str, Any], folder: Path) -> None:
    _job[:] = [Experiment.model_validate(plain), folder]


def _write(shard: Shard) -> Written:
    experiment, folder = _job
    return write_shard(experiment, shard, folder)
