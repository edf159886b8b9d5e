"""The local engine: shards are written in this process, or in a pool that survives the death of a worker."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, suppress
from itertools import islice
from multiprocessing import connection
from pathlib import Path
from typing import Any

from ibdata.errors import IbdataError
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.generation.origin import agree
from ibdata.generation.output_folder import refuse_moved, sweep_shards
from ibdata.policies.custom import started_in
from ibdata.system.processes import Spawning
from ibdata.system.signals import check, held
from ibdata.writing import receipt
from ibdata.writing.shard_writer import (
    ShardWriter,
    Threads,
    WrittenShard,
    shard_writer,
    thread,
    writing_threads,
)
from ibdata.writing.summary import simulated

MAX_DEATHS = 3  # of workers, without a shard finished in between


def run(
    spec: DatasetSpec, shards: list[Shard], root: Path, identity: str, workers: int
) -> Iterator[WrittenShard]:
    """Write the shards, yielding each when it and its receipt are on the disk, in any order.

    If a worker dies, the shards in progress are made again. Raises IbdataError after three deaths in a row.
    """
    alone = multiprocessing.current_process().daemon  # a daemon may not have children
    if workers == 1 or len(shards) <= 1 or alone:
        yield from _one_after_the_other(spec, shards, root, identity)
        return
    missing = {shard.number: shard for shard in shards}
    deaths = 0
    while missing:
        try:
            for made in _pool(spec, list(missing.values()), root, identity, workers):
                del missing[made.shard.number]
                deaths = 0
                yield made
        except BrokenProcessPool:
            sweep_shards(root, missing.values())
            deaths += 1
            if deaths == MAX_DEATHS:
                raise IbdataError(
                    "three worker processes died in a row, probably out of memory; run again with --resume "
                    "and fewer --workers"
                ) from None


def _one_after_the_other(
    spec: DatasetSpec, shards: list[Shard], root: Path, identity: str
) -> Iterator[WrittenShard]:
    """Simulate each shard while the one before it is finished in a thread."""
    with writing_threads() as threads, thread() as finishing:
        before: Future[WrittenShard] | None = None
        for shard in shards:
            with ExitStack() as opened:
                writer = _filled(opened, spec, shard, root, threads)
                made = before.result() if before else None  # wait, so that at most two are in memory
                before = finishing.submit(_finish, writer, opened.pop_all(), root, identity)
            if made:
                yield made
            check()
        if before:
            yield before.result()
            check()


def _pool(
    spec: DatasetSpec, shards: list[Shard], root: Path, identity: str, workers: int
) -> Iterator[WrittenShard]:
    before = set(multiprocessing.active_children())
    folders = (started_in.get() or os.getcwd(), spec.experiments[0].folder)
    with held():
        pool = ProcessPoolExecutor(
            min(workers, len(shards)),
            Spawning(),
            initializer=_start,
            initargs=(spec.plain(), root, identity, *folders),
        )
    waiting = iter(shards)
    running: set[Future[WrittenShard]] = set()
    try:
        while True:
            more = islice(waiting, 2 * workers - len(running))
            with held():
                running |= {pool.submit(_work, shard) for shard in more}
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            check()
            yield from (future.result() for future in done)
    except BaseException:
        for process in set(multiprocessing.active_children()) - before:
            process.kill()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


_job: list[Any] = []  # in a worker: spec, dataset's folder, identity, YAML's folder; set when it starts


def _start(plain: dict[str, Any], root: Path, identity: str, here: str, folder: Path | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal signals every process; the parent reacts
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGTERM])
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(OSError):  # the folder was removed
        os.chdir(here)  # a policy may have changed the parent's current folder
    started_in.set(here)
    _job[:] = [DatasetSpec.from_plain(plain), root, identity, folder]


def _end_with_parent() -> None:
    """End this worker if its parent is killed; otherwise it would go on writing (cpython#111873)."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def _work(shard: Shard) -> WrittenShard:
    spec, root, identity, folder = _job
    agree(root, spec, folder)
    return write_shard(spec, shard, root, identity)


def write_shard(spec: DatasetSpec, shard: Shard, root: Path, identity: str) -> WrittenShard:
    """Simulate a shard and write it, then its receipt."""
    with writing_threads() as threads, ExitStack() as opened:
        writer = _filled(opened, spec, shard, root, threads)
        return _finish(writer, opened.pop_all(), root, identity)


def _filled(opened: ExitStack, spec: DatasetSpec, shard: Shard, root: Path, threads: Threads) -> ShardWriter:
    """Open the writer of a shard, simulate the shard, and hand all its parts to the writer."""
    writer = opened.enter_context(shard_writer(spec, shard, root, threads))
    for part, floats in simulated(spec, shard):
        writer.add(part, floats)
    return writer


def _finish(writer: ShardWriter, opened: ExitStack, root: Path, identity: str) -> WrittenShard:
    """Commit a shard to which all parts were added, then its receipt."""
    with opened:
        made = writer.finish()
        refuse_moved(root, identity)
    receipt.put(root, identity, made)
    return made
