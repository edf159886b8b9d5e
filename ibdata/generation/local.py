"""The local engine: shards are made in this process, or in a pool that survives the death of a worker."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from pathlib import Path

from ibdata.errors import IbdataError
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.generation.division import divide
from ibdata.generation.make_shard import Tell, filled, finish, untold, write_shard
from ibdata.generation.output_folder import forget
from ibdata.generation.worker_pool import run_pool
from ibdata.system.signals import check, held
from ibdata.writing.shard_writer import WrittenShard, thread, writing_threads

MAX_DEATHS = 3  # of workers, without a shard finished in between


def run(
    spec: DatasetSpec,
    shards: list[Shard],
    root: Path,
    identity: str,
    workers: int | None,
    tell: Tell = untold,
) -> Iterator[WrittenShard]:
    """Write the shards, yielding each when it and its receipt are on the disk, in any order.

    `tell` is called after each part of a shard, perhaps in another thread.
    If a worker dies, the shards in progress are made again. Raises IbdataError after three deaths in a row.
    """
    division = divide(spec, shards, workers)
    if division.processes == 1 or multiprocessing.current_process().daemon:  # it may not have children
        at_once = min(division.threads, len(shards))
        if at_once > 1:
            yield from _side_by_side(spec, shards, root, identity, at_once, tell)
        else:
            yield from _one_after_the_other(spec, shards, root, identity, tell)
        return
    missing = {shard.number: shard for shard in shards}
    deaths = 0
    while missing:
        try:
            for made in run_pool(spec, list(missing.values()), root, identity, division, tell):
                del missing[made.shard.number]
                deaths = 0
                yield made
        except BrokenProcessPool:
            forget(root, missing.values())
            deaths += 1
            if deaths == MAX_DEATHS:
                raise IbdataError(
                    "three worker processes died in a row, probably out of memory; run again with --resume "
                    "and fewer --workers"
                ) from None


def _side_by_side(
    spec: DatasetSpec, shards: list[Shard], root: Path, identity: str, threads: int, tell: Tell
) -> Iterator[WrittenShard]:
    """Make several shards at once, each in a thread."""
    stopped = threading.Event()
    overlap = len(shards) < 2 * threads  # else each thread has enough to do
    with ThreadPoolExecutor(threads) as pool:
        try:
            with held():
                waiting = {
                    pool.submit(write_shard, spec, shard, root, identity, overlap, stopped, tell)
                    for shard in shards
                }
            while waiting:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                check()
                yield from (future.result() for future in done)
        except BaseException:
            stopped.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _one_after_the_other(
    spec: DatasetSpec, shards: list[Shard], root: Path, identity: str, tell: Tell
) -> Iterator[WrittenShard]:
    """Simulate each shard while the one before it is finished in a thread."""
    with writing_threads() as threads, thread() as finishing:
        before: Future[WrittenShard] | None = None
        for shard in shards:
            with ExitStack() as opened:
                writer = filled(opened, spec, shard, root, threads, tell=tell)
                made = before.result() if before else None  # wait, so that at most two are in memory
                before = finishing.submit(finish, writer, opened.pop_all(), root, identity)
            if made:
                yield made
            check()
        if before:
            yield before.result()
            check()
