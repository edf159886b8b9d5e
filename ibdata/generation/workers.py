"""Making the shards of a run in threads, each of which makes them itself or has a process for it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

from ibdata.experiment.code import customs, live_objects
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.generation.make_shard import make_shard
from ibdata.generation.worker import Process, Tell, Worker
from ibdata.system.processes import available_processors
from ibdata.system.signals import check, held

# Threads of a process share Python's lock, which a thread that makes a shard holds for an eighth of its time.
MOST_THREADS = 4
# A process starts in more than a second. In that time, two threads make 3 million rows.
ROWS_WORTH_PROCESSES = 20_000_000
LOOK = 0.2  # seconds between looks for a signal
Make = Callable[[Shard, Tell], None]


class Division(NamedTuple):
    """The number of processes that make shards, and how many shards each makes at a time."""

    processes: int
    threads: int


def divide(spec: DatasetSpec, shards: list[Shard], workers: int | None) -> Division:
    """Divide shards among processes and threads.

    One process that makes several shards at once in threads is the fastest choice on few processors. Custom
    policies get a process for each shard, since their code need not stand threads and holds Python's lock; a
    live object has only the session's.

    Args:
        spec: What the shards belong to.
        shards: The shards to make.
        workers: The number of processes; None chooses it by the work.
    """
    processors, custom = available_processors(), bool(customs(spec))
    if live_objects(spec):
        return Division(1, 1)
    if workers is None:
        rows = sum((shard.stop - shard.first) * spec.of_shard(shard).steps for shard in shards)
        many = custom or (processors > MOST_THREADS and rows >= ROWS_WORTH_PROCESSES)
        workers = processors if many else 1
    processes = max(1, min(workers, len(shards)))
    threads = 1 if custom else min(MOST_THREADS, max(1, processors // processes))
    return Division(processes, threads)


def run(process: Process, shards: list[Shard], root: Path, workers: int | None, tell: Tell) -> Iterator[int]:
    """Make shards, and yield the number of each when it and its receipt are on the disk, in any order.

    Args:
        process: The process that has the code of the dataset's custom policies. It makes shards too.
        shards: The shards to make.
        root: The part in which the dataset is made.
        workers: The number of processes; None chooses it by the work.
        tell: Called after each piece of a shard, perhaps in another thread.

    Raises:
        IbdataError: A worker process ended, or a shard cannot be made.
    """
    if not shards:
        return
    spec, division = process.spec, divide(process.spec, shards, workers)
    at_once = division.processes if division.processes > 1 else min(division.threads, len(shards))
    makers: SimpleQueue[Make] = SimpleQueue()

    def make(shard: Shard) -> int:
        maker = makers.get()
        try:
            maker(shard, tell)
        finally:
            makers.put(maker)  # for those that wait, which are about to be stopped if this one failed
        return shard.number

    with ExitStack() as stack:
        pool = ThreadPoolExecutor(at_once)
        stack.callback(pool.shutdown, cancel_futures=True)
        if isinstance(process, Worker) or division.processes > 1:
            for i in range(at_once):
                worker = process if isinstance(process, Worker) and i == 0 else Worker(spec, root)
                stack.callback(worker.close)
                makers.put(_maker(worker, root, division.threads > 1, None))
        else:
            stopped = threading.Event()
            stack.callback(stopped.set)
            overlap = at_once == 1 or len(shards) < 2 * at_once  # else each thread has enough to do
            for _ in range(at_once):
                makers.put(_maker(process, root, overlap, stopped))
        with held():  # a signal's exception while a thread starts would leave it running
            waiting: set[Future[int]] = {pool.submit(make, shard) for shard in shards}
        while waiting:
            done, waiting = wait(waiting, LOOK, FIRST_COMPLETED)
            check()
            for future in done:
                yield future.result()


def _maker(process: Process, root: Path, overlap: bool, stopped: threading.Event | None) -> Make:
    return lambda shard, tell: process.call(make_shard, shard, root, overlap, stopped, tell=tell)
