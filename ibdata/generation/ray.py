"""The Ray engine: shards are tasks of Ray, on this machine or on hosts that share a folder or a store."""

from __future__ import annotations

import json
import os
import secrets
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from tempfile import gettempdir
from typing import Any, cast

from ibdata._system import processes
from ibdata._system.progress import unseen
from ibdata._system.runs import Run
from ibdata._system.signals import STOPPING, check
from ibdata.errors import IbdataError, missing, reason
from ibdata.generation.process import Here, Process, WorkerTask
from ibdata.generation.record import agree
from ibdata.generation.workers import LOOK, make_shard
from ibdata.plan.dataset_spec import DatasetSpec, Shard

MAX_DEATHS = 3  # of workers, at one shard


def library() -> Any:
    """Import Ray. Raises IbdataError if it is not installed."""
    with _own_handlers():  # the import replaces the handler of SIGTERM
        try:
            import ray
        except ImportError:
            raise missing("the engine ray", "ray", "ray") from None
    return ray


def make_shards(
    process: Process, shards: list[Shard], run: Run, workers: int | None, address: str | None
) -> Iterator[int]:
    """Make shards, and yield the number of each when it and its receipt are kept, in any order.

    The shards run on the Ray to which this process is connected, else on the one at `address` or
    $RAY_ADDRESS, else on one that is started here and stopped afterwards. There are at most `workers`
    workers, by default one per processor of Ray. If a worker dies, Ray makes its shard again.

    Raises IbdataError if workers die repeatedly at one shard, or if Ray does not answer at its address.
    """
    ray = library()
    with _connected(ray, workers, address) as is_started:
        work = ray.remote(max_retries=MAX_DEATHS, **_own_workers(process.spec))(_work)
        task = ray.put(WorkerTask(process.spec, process.folder, run))
        most = 2 * (workers or max(1, int(ray.cluster_resources().get("CPU", 1))))
        waiting = iter(shards)
        running: dict[Any, Shard] = {}
        try:
            while True:
                while len(running) < most and (shard := next(waiting, None)) is not None:
                    running[work.remote(task, shard)] = shard
                if not running:
                    return
                done, _ = ray.wait(list(running), timeout=LOOK)
                check()
                for future in done:
                    shard = running.pop(future)
                    _wait_for(ray, future, shard)
                    yield shard.number
        except SystemError:  # a signal's exception was raised inside compiled code of Ray
            check()
            raise
        finally:
            if running and not is_started:  # a Ray that was started here is stopped with its workers
                for future in running:
                    ray.cancel(future)  # not by force, which may crash Ray 2.60 itself
                ray.wait(list(running), num_returns=len(running), timeout=30)


def _wait_for(ray: Any, future: Any, shard: Shard) -> None:
    try:
        ray.get(future)
    except ray.exceptions.RayTaskError as error:
        raise error.cause from None
    except ray.exceptions.RayError as error:
        what = f"{type(error).__name__}: {reason(error)}"
        raise IbdataError(f"{shard.stem}: Ray failed with {what}; the same command goes on") from None


def _own_workers(spec: DatasetSpec) -> dict[str, Any]:
    """Options that give a run with custom code workers that have imported none: those of an environment."""
    if not spec.user_objects:
        return {}
    machine_code = os.path.join(gettempdir(), f"ibdata-{secrets.token_hex(8)}")  # of its host
    return {"runtime_env": {"env_vars": {"NUMBA_CACHE_DIR": machine_code}}}


# This worker, by the place of a run and its experiments; its record was compared with that of the run.
_known: dict[tuple[str, str], Here] = {}


def _work(task: WorkerTask, shard: Shard) -> None:
    """Make a shard in a worker."""
    processes.purpose, run = "worker", cast("Run", task.run)
    known = run.name, json.dumps(task.spec.plain(), sort_keys=True)
    if known not in _known:
        here = Here(task.spec, task.folder)
        here.call(agree, run)
        _known[known] = here
    _known[known].call(make_shard, shard, run, True, None, progress=unseen)


@contextmanager
def _connected(ray: Any, workers: int | None, address: str | None) -> Iterator[bool]:
    """Connect to Ray. Yields whether it was started here, and is therefore stopped afterwards."""
    if ray.is_initialized():
        yield False
        return
    place = address or os.environ.get("RAY_ADDRESS") or "local"
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    if place == "local":
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # Ray would report each start to its makers
        quiet |= {"num_cpus": workers, "include_dashboard": False}
    try:
        with _own_handlers():
            try:
                _knock(place)
                ray.init(place, **quiet)
            except Exception as error:  # Ray raises whatever went wrong
                if place == "local":
                    problem = f"engine: ray: did not start on this machine ({reason(error)})"
                else:
                    problem = f"address: {place}: found no answer ({reason(error)}), expected a running Ray"
                    problem += "; correct the address or leave it out"
                raise IbdataError(problem) from None
        yield place == "local"
    finally:
        with _own_handlers():
            ray.shutdown()


def _knock(place: str) -> None:
    """Raise OSError at once if nothing listens at host:port; Ray itself would try for minutes."""
    host, colon, port = place.removeprefix("ray://").rpartition(":")
    if colon and port.isdigit():
        socket.create_connection((host.strip("[]"), int(port)), timeout=5).close()


@contextmanager
def _own_handlers() -> Iterator[None]:
    """Restore the signal handlers that Ray replaces with its own."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in STOPPING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
