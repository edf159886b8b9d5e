"""Processors, and worker processes that do not import the script that starts them, so it needs no guard."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.process import BaseProcess
from types import ModuleType
from typing import Any

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
    with _lock:
        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main


class _Process(SpawnProcess):
    @staticmethod
    def _Popen(process_obj: BaseProcess) -> Any:
        with _nameless_main():
            return SpawnProcess._Popen(process_obj)


class Spawning(SpawnContext):
    """multiprocessing's context `spawn` without the import of `__main__`.

    Processes are not forked, because a forked child would inherit threads, open files and locks.
    """

    Process = _Process
