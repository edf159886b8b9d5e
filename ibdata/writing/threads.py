"""Three threads beside the one that simulates, and a bound on what waits for them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from types import TracebackType
from typing import TypeVar

WAITING = 2  # parts

Task = Callable[[], object]
T = TypeVar("T")


class Threads:
    """One encodes, one describes, one finishes; each does what is handed to it in order.

    A part is taken when both have ended with the one before the last, so that memory does not grow.
    """

    def __init__(self) -> None:
        self._encoding, self._describing, self._finishing = (ThreadPoolExecutor(1) for _ in range(3))
        self._threads = (self._encoding, self._describing, self._finishing)
        self._waiting: deque[tuple[Future[object], Future[object]]] = deque()
        try:
            # Now: a thread during whose start a signal raises runs on, and nobody would wait for it.
            for thread in self._threads:
                thread.submit(int).result()
        except BaseException:
            for thread in self._threads:
                thread.shutdown(wait=False)
            raise

    def take(self, encode: Task, describe: Task) -> tuple[Future[object], Future[object]]:
        """Hand over what is to be done with a part."""
        if len(self._waiting) == WAITING:
            wait(self._waiting.popleft())
        taken = self._encoding.submit(encode), self._describing.submit(describe)
        self._waiting.append(taken)
        return taken

    def finish(self, task: Callable[[], T]) -> Future[T]:
        """Hand over what ends a shard."""
        return self._finishing.submit(task)

    def __enter__(self) -> Threads:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for thread in reversed(self._threads):
            thread.shutdown()
