"""How the shards of a run are divided among processes and threads."""

from __future__ import annotations

from typing import NamedTuple

from ibdata.experiment.custom_code import customs
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.system.processes import available_processors

# Threads of a process share Python's lock, which a thread that makes a shard holds for an eighth of its time.
MOST_THREADS = 4
# A process starts in more than a second. In that time, two threads make 3 million rows.
ROWS_WORTH_PROCESSES = 20_000_000


class Division(NamedTuple):
    """The number of processes that make shards, and the number of threads in each of them."""

    processes: int
    threads: int


def divide(spec: DatasetSpec, shards: list[Shard], workers: int | None) -> Division:
    """Divide shards among processes and threads.

    One process that makes several shards at once in threads is the fastest choice on few processors. Custom
    policies get a process for each shard, since their code need not stand threads and holds Python's lock.

    Args:
        spec: What the shards belong to.
        shards: The shards to make.
        workers: The number of processes; None chooses it by the work.
    """
    processors, custom = available_processors(), bool(customs(spec))
    if workers is None:
        rows = sum((shard.stop - shard.first) * spec.of_shard(shard).steps for shard in shards)
        many = custom or (processors > MOST_THREADS and rows >= ROWS_WORTH_PROCESSES)
        workers = processors if many else 1
    processes = max(1, min(workers, len(shards)))
    threads = 1 if custom else min(MOST_THREADS, max(1, processors // processes))
    return Division(processes, threads)
