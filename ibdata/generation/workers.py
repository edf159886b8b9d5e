"""Making the shards of a run, in threads that make them here or in processes, or on Ray."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack
from functools import partial
from queue import SimpleQueue
from typing import NamedTuple

from ibdata._system.processes import available_processors
from ibdata._system.runs import Run
from ibdata._system.signals import check, held
from ibdata.errors import UsageError
from ibdata.generation.pieces import simulated
from ibdata.generation.process import Process, RowsMade, Worker
from ibdata.generation.shard import write_receipt, write_shard
from ibdata.plan.dataset_spec import DatasetSpec, Shard
from ibdata.plan.rollout import TableBuffer

ENGINES = ("local", "ray")
MAX_WORKERS = 1024
# Threads of a process share Python's lock, which a thread that makes a shard holds for an eighth of its time.
MOST_THREADS = 4
# A process starts in more than a second. In that time, two threads make 3 million rows.
ROWS_WORTH_PROCESSES = 20_000_000
LOOK = 0.2  # seconds between looks for a signal

Reach = Callable[[int, int], object]  # called with the number of a shard and its rows that are made so far
# Makes shards of a run, and yields the number of each that is finished. The process has the
# code of the dataset's custom policies.
Engine = Callable[[Process, list[Shard], Run, Reach], Iterator[int]]
Maker = Callable[[Shard, RowsMade], None]


def select_engine(name: str, workers: int | None, address: str | None) -> Engine:
    """The engine with a name.

    Raises:
        UsageError: The name, the number of workers or the address is invalid.
        IbdataError: The engine's library is not installed.
    """
    if name not in ENGINES:
        raise UsageError(f"engine: found {name!r}, expected one of {', '.join(ENGINES)}")
    refuse_workers(workers)
    if name == "ray":
        from ibdata.generation import ray

        ray.library()
        return lambda process, shards, run, reach: ray.make_shards(process, shards, run, workers, address)
    if address is not None:
        raise UsageError(f"address: found {address!r}, which is only for the engine ray")
    return lambda process, shards, run, reach: make_shards(process, shards, run, workers, reach)


def refuse_workers(workers: int | None) -> None:
    """Raise UsageError for a number of workers that is out of range; None chooses it by the work."""
    if workers is not None and not 1 <= workers <= MAX_WORKERS:
        raise UsageError(f"workers: found {workers!r}, expected a whole number in [1, {MAX_WORKERS}]")


class Division(NamedTuple):
    """How many processes make shards; and in a single process, how many shards are made at once."""

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
    if spec.live:
        return Division(1, 1)
    processors, own_code = available_processors(), bool(spec.custom)
    if workers is None:
        many = own_code or (processors > MOST_THREADS and spec.rows_in(shards) >= ROWS_WORTH_PROCESSES)
        workers = processors if many else 1
    processes = max(1, min(workers, len(shards)))
    threads = 1 if own_code else min(MOST_THREADS, max(1, processors // processes))
    return Division(processes, threads)


def make_shards(
    process: Process, shards: list[Shard], run: Run, workers: int | None, reach: Reach
) -> Iterator[int]:
    """Make shards, and yield the number of each when it and its receipt are kept, in any order.

    Args:
        process: The process that has the code of the dataset's custom policies. It makes shards too.
        shards: The shards to make.
        run: The run.
        workers: The number of processes; None chooses it by the work.
        reach: Called while a shard is made, perhaps in another thread.

    Raises:
        IbdataError: A worker process ended, or a shard cannot be made.
    """
    if not shards:
        return
    spec, division = process.spec, divide(process.spec, shards, workers)
    at_once = division.processes if division.processes > 1 else min(division.threads, len(shards))
    makers: SimpleQueue[Maker] = SimpleQueue()

    def make(shard: Shard) -> int:
        maker = makers.get()
        try:
            maker(shard, partial(reach, shard.number))
        finally:
            makers.put(maker)  # for those that wait, which are about to be stopped if this one failed
        return shard.number

    with ExitStack() as stack:
        pool = ThreadPoolExecutor(at_once)
        stack.callback(pool.shutdown, cancel_futures=True)
        if isinstance(process, Worker) or division.processes > 1:
            for i in range(at_once):
                worker = (
                    process if isinstance(process, Worker) and i == 0 else Worker(spec, process.folder, run)
                )
                stack.callback(worker.close)
                makers.put(_maker(worker, run, division.threads > 1, None))
        else:
            stopped = threading.Event()
            stack.callback(stopped.set)
            few_shards = at_once == 1 or len(shards) < 2 * at_once  # else each thread has enough to do
            overlap = few_shards and available_processors() > 1
            for _ in range(at_once):
                makers.put(_maker(process, run, overlap, stopped))
        with held():  # a signal's exception while a thread starts would leave it running
            waiting: set[Future[int]] = {pool.submit(make, shard) for shard in shards}
        while waiting:
            done, waiting = wait(waiting, LOOK, FIRST_COMPLETED)
            check()
            for future in done:
                yield future.result()


def _maker(process: Process, run: Run, overlap: bool, stopped: threading.Event | None) -> Maker:
    return lambda shard, progress: process.call(make_shard, shard, run, overlap, stopped, progress=progress)


class Stopped(Exception):
    """Another thread asked to stop."""


_of_thread = threading.local()  # what a thread keeps from one shard to the next: its `memory`


def make_shard(
    spec: DatasetSpec,
    shard: Shard,
    run: Run,
    overlap: bool,
    stopped: threading.Event | None,
    progress: RowsMade,
) -> None:
    """Simulate a shard and write it piece by piece, then its receipt.

    Args:
        spec: What the shard belongs to.
        shard: The shard.
        run: The run.
        overlap: Whether to encode and summarize a piece in threads while the next is simulated.
        stopped: Set by another thread to end the work early, or None.
        progress: Called with the rows that are made so far, after some steps of some episodes.

    Raises:
        Stopped: `stopped` was set.
    """
    memory = None
    if not overlap:  # a piece is written before the next is simulated
        memory = _of_thread.memory = getattr(_of_thread, "memory", None) or TableBuffer()

    made = 0

    def advance(rows: int) -> None:
        nonlocal made
        if stopped is not None and stopped.is_set():
            raise Stopped
        made += rows
        progress(made)

    pieces = simulated(spec, shard, memory, advance)
    write_receipt(run, write_shard(spec, shard, pieces, run, overlap))
