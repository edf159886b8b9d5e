"""Worker processes that make shards, and that end with the process that started them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import suppress
from itertools import islice
from multiprocessing import connection
from pathlib import Path
from typing import Any

from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.generation.division import Division
from ibdata.generation.make_shard import write_shard
from ibdata.generation.origin import agree
from ibdata.policies.code_places import code_places, look_in
from ibdata.system.processes import Spawning
from ibdata.system.signals import check, held
from ibdata.writing.shard_writer import WrittenShard


def run_pool(
    spec: DatasetSpec, shards: list[Shard], root: Path, identity: str, division: Division
) -> Iterator[WrittenShard]:
    before = set(multiprocessing.active_children())
    folders = (code_places()[0], spec.experiments[0].folder)
    with held():
        pool = ProcessPoolExecutor(
            division.processes,
            Spawning(),
            initializer=_start,
            initargs=(spec.plain(), root, identity, division.threads > 1, *folders),
        )
    waiting = iter(shards)
    running: set[Future[WrittenShard]] = set()
    try:
        while True:
            more = islice(waiting, 2 * division.processes - len(running))
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


_job: list[Any] = []  # what the shards of a worker have in common, set once when it starts


def _start(
    plain: dict[str, Any], root: Path, identity: str, overlap: bool, here: Path, folder: Path | None
) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal signals every process; the parent reacts
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGTERM])
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(OSError):  # the folder was removed
        os.chdir(here)  # a policy may have changed the parent's current folder
    look_in(here, folder)
    _job[:] = [DatasetSpec.from_plain(plain), root, identity, overlap]


def _end_with_parent() -> None:
    """End this worker if its parent is killed; otherwise it would go on writing (cpython#111873)."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def _work(shard: Shard) -> WrittenShard:
    spec, root, identity, overlap = _job
    agree(root, spec)
    return write_shard(spec, shard, root, identity, overlap)
