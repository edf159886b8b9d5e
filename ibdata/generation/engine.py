"""The engines that run shards, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from ibdata.errors import UsageError
from ibdata.experiment.plan import Shard
from ibdata.generation.worker import Process, Tell

ENGINES = ("local", "ray")
MAX_WORKERS = 1024

# Makes shards in a part, and yields the number of each that is finished; the pieces of shards are told. The
# process has the code of the dataset's custom policies.
Run = Callable[[Process, list[Shard], Path, Tell], Iterator[int]]


def select_engine(name: str, workers: int | None, address: str | None) -> Run:
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
        return lambda process, shards, root, tell: ray.run(process.spec, shards, root, workers, address)
    if address is not None:
        raise UsageError(f"address: found {address!r}, which is only for the engine ray")
    from ibdata.generation.workers import run

    return lambda process, shards, root, tell: run(process, shards, root, workers, tell)


def refuse_workers(workers: int | None) -> None:
    """Raise UsageError for a number of workers that is out of range; None chooses it by the work."""
    if workers is not None and not 1 <= workers <= MAX_WORKERS:
        raise UsageError(f"workers: found {workers!r}, expected a whole number in [1, {MAX_WORKERS}]")
