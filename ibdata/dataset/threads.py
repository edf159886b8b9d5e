"""Two threads beside the one that simulates, and a bound on what waits for them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from types import TracebackType

WAITING = 2  # parts

Task = Callable[[], None]


class Threads:
    """Each of the two does what is handed to it in order, for one shard after another.

    A part is taken when both have ended with the one before the last, so that memory does not grow.
    """

    def __init__(self) -> None:
        self._first, self._second = ThreadPoolExecutor(1), ThreadPoolExecutor(1)
        self._waiting: deque[tuple[Future[None], Future[None]]] = deque()

    def take(self, first: Task, second: Task) -> tuple[Future[None], Future[None]]:
        """Hand a task to each thread."""
        if len(self._waiting) == WAITING:
            wait(self._waiting.popleft())
        taken = self._first.submit(first), self._second.submit(second)
        self._waiting.append(taken)
        return taken

    def __enter__(self) -> Threads:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for thread in (self._first, self._second):
            thread.shutdown()
