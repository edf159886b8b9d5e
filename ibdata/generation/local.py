"""Shards on this machine: in this process, or in a pool of fresh ones that survives a killed worker."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from functools import partial
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
from ibdata.writing.shard_writer import ShardWriter, WrittenShard
from ibdata.writing.threads import Threads

MAX_DEATHS = 3  # of workers, without a shard finished in between


def run(
    spec: DatasetSpec, shards: list[Shard], root: Path, identity: str, workers: int
) -> Iterator[WrittenShard]:
    """Write the shards, yielding each when it and its receipt are on the disk, in any order.

    A worker that dies costs the shards in work, which are done again; IbdataError after three deaths in a
    row.
    """
    alone = multiprocessing.current_process().daemon  # which may not have children
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
    """Each is simulated while the one before it is finished in a thread."""
    with Threads() as threads:
        before: Future[WrittenShard] | None = None
        for shard in shards:
            begun = ShardWriter(spec, shard, root, threads)
            try:
                made = before.result() if before else None  # so that no more than two are in memory
                before = threads.finish(partial(_finished, begun, root, identity))
            except BaseException:
                begun.abandon()
                raise
            del begun
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
        for shard in waiting:
            with held():
                running.add(pool.submit(_work, shard))
            if len(running) == 2 * workers:
                break
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            check()
            for future in done:
                yield future.result()
                with held():
                    running.update(pool.submit(_work, shard) for shard in _one(waiting))
    except BaseException:
        for process in set(multiprocessing.active_children()) - before:
            process.kill()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _one(shards: Iterator[Shard]) -> list[Shard]:
    return [shard for _, shard in zip(range(1), shards, strict=False)]


_job: list[Any] = []  # a worker's recipe, folder, identity and the YAML's folder, set once when it starts


def _start(plain: dict[str, Any], root: Path, identity: str, here: str, folder: Path | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal tells all; the parent decides
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGTERM])
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(OSError):  # it was removed
        os.chdir(here)  # a policy may have led the parent elsewhere
    started_in.set(here)
    _job[:] = [DatasetSpec.from_plain(plain), root, identity, folder]


def _end_with_parent() -> None:
    """Executor workers would live on, and write on, when their parent is killed (cpython#111873)."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def _work(shard: Shard) -> WrittenShard:
    spec, root, identity, folder = _job
    agree(root, spec, folder)
    return written(spec, shard, root, identity)


def written(spec: DatasetSpec, shard: Shard, root: Path, identity: str) -> WrittenShard:
    """A shard that is on the disk, and its receipt after it."""
    with Threads() as threads:
        return _finished(ShardWriter(spec, shard, root, threads), root, identity)


def _finished(begun: ShardWriter, root: Path, identity: str) -> WrittenShard:
    made = begun.finish(partial(refuse_moved, root, identity))
    receipt.put(root, identity, made)
    return made
