"""Processors, and worker processes that end with their parent and import nothing from its script or folder.

So the script needs no guard, and files in the folder of a dataset do not run.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import util
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.process import BaseProcess
from multiprocessing.resource_tracker import ensure_running
from types import ModuleType
from typing import Any

LOOK = 0.1  # seconds between two looks of a worker at whether its parent is there
_lock = threading.Lock()


def available_processors() -> int:
    """The number of processors that this process may use, else that the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _nameless_main() -> Iterator[None]:
    """Replace `__main__` by a module that has neither a name nor a file, as in a notebook.

    multiprocessing makes a spawned process import the `__main__` of its parent first. That would start the
    run again in a script without a guard, and fail for a script that was read from stdin.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextmanager
def _current_folder_unsearched() -> Iterator[None]:
    """Start new processes without the current folder on the path of modules.

    multiprocessing starts `python -c`, which looks there before all else: a file signal.py would be imported
    in place of Python's. A worker is given the path of its parent afterwards.
    """
    start = util.spawnv_passfds

    def start_safely(path: Any, args: Any, fds: Any) -> int:
        code = args.index("-c") + 1
        args[code] = f"import sys; sys.path[:] = filter(None, sys.path); {args[code]}"
        return start(path, args, fds)

    util.spawnv_passfds = start_safely  # type: ignore[assignment]
    try:
        yield
    finally:
        util.spawnv_passfds = start


class _Process(SpawnProcess):
    def __reduce__(self) -> tuple[Any, ...]:
        """A worker learns first which process its parent is, then what to import, which takes seconds."""
        return _begun, (os.getpid(),), vars(self)

    @staticmethod
    def _Popen(process_obj: BaseProcess) -> Any:
        with _lock, _nameless_main(), _current_folder_unsearched():
            return SpawnProcess._Popen(process_obj)


def _begun(parent: int) -> _Process:
    """A worker in its own process, which ends with its parent; otherwise it would go on (cpython#111873)."""
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    return _Process.__new__(_Process)


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(LOOK)
    os._exit(1)


class Spawning(SpawnContext):
    """multiprocessing's context `spawn`: no imports of `__main__` or from the current folder, no orphans.

    Processes are not forked, because a forked child would inherit threads, open files and locks.
    """

    Process = _Process

    def __init__(self) -> None:
        with _lock, _current_folder_unsearched():
            ensure_running()  # the process that tracks locks, which multiprocessing starts with the first one
