"""Worker processes that make shards."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from itertools import islice
from multiprocessing import connection
from pathlib import Path
from struct import Struct
from typing import Any

from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.generation.division import Division
from ibdata.generation.make_shard import Tell, write_shard
from ibdata.generation.origin import agree
from ibdata.policies.code_places import code_places, look_in
from ibdata.system.processes import Spawning
from ibdata.system.signals import check, held
from ibdata.writing.shard_writer import WrittenShard

LISTEN = 0.2  # seconds between looks at what workers tell
PATIENCE = 2.0  # seconds in which the pool itself should notice that a worker has ended
NUMBERS = Struct("<qq")  # a shard and its rows


def run_pool(
    spec: DatasetSpec, shards: list[Shard], root: Path, identity: str, division: Division, tell: Tell
) -> Iterator[WrittenShard]:
    before = set(multiprocessing.active_children())
    folders = (code_places()[0], spec.experiments[0].folder)
    told, telling = multiprocessing.Pipe(duplex=False)
    os.set_blocking(telling.fileno(), False)  # a worker never waits for somebody to listen
    with held():
        pool = ProcessPoolExecutor(
            division.processes,
            Spawning(),
            initializer=_start,
            initargs=(spec.plain(), spec.weights, root, identity, division.threads > 1, *folders, telling),
        )
        # All workers start with the first shard. If some started later, the thread of the pool, which ends it
        # when a worker has died, could meet a half-started one. There is no public way to ask for this.
        pool._safe_to_dynamically_spawn_children = False  # type: ignore[attr-defined]
    waiting = iter(shards)
    running: set[Future[WrittenShard]] = set()
    most, missed = 0, 0  # workers alive at once; looks at which one was gone and nothing was done
    try:
        while True:
            more = islice(waiting, 2 * division.processes - len(running))
            with held():
                running |= {pool.submit(_work, shard) for shard in more}
            if not running:
                return
            done, running = wait(running, LISTEN, FIRST_COMPLETED)
            check()
            alive = len(set(multiprocessing.active_children()) - before)
            most, missed = max(most, alive), 0 if done or alive >= most else missed + 1
            if missed * LISTEN > PATIENCE:
                raise BrokenProcessPool("a worker process ended while it sent its result")
            while told.poll():  # what is told of a shard comes before its result
                tell(*NUMBERS.unpack(told.recv_bytes()))
            yield from (future.result() for future in done)
    except BaseException:
        for process in set(multiprocessing.active_children()) - before:
            process.kill()
        _end_results(pool)
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        told.close()
        telling.close()


def _end_results(pool: ProcessPoolExecutor) -> None:
    """Close this process's copy of the pipe for results, into which workers write that are dead now.

    If one was killed while it wrote, the pool's thread waits for the rest, and `shutdown` for the thread. It
    sees the end of the pipe only when nobody could write any more.
    """
    with suppress(AttributeError, OSError):
        pool._result_queue._writer.close()  # type: ignore[attr-defined]  # there is no public way


_job: list[Any] = []  # what the shards of a worker have in common, set once when it starts


def _start(
    plain: dict[str, Any],
    weights: dict[str, bytes],
    root: Path,
    identity: str,
    overlap: bool,
    here: Path,
    folder: Path | None,
    telling: connection.Connection,
) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal signals every process; the parent reacts
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGTERM])
    with suppress(OSError):  # the folder was removed
        os.chdir(here)  # a policy may have changed the parent's current folder
    look_in(here, folder)
    _job[:] = [DatasetSpec.from_plain(plain, weights), root, identity, overlap, telling]


def _work(shard: Shard) -> WrittenShard:
    spec, root, identity, overlap, telling = _job
    agree(root, spec)

    def tell(number: int, rows: int) -> None:
        with suppress(OSError):  # the pipe is full; so few bytes are written all or not at all
            telling.send_bytes(NUMBERS.pack(number, rows))

    return write_shard(spec, shard, root, identity, overlap, tell=tell)
