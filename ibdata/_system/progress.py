"""Bars on stderr, or in a notebook, that show how far a long task is."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Advance = Callable[[int], object]  # called with the number of units that have been done since


def unseen(units: int) -> None:
    """An `Advance` that shows nothing."""


@contextmanager
def bar(progress: bool | None, total: int, unit: str, what: str | None = None) -> Iterator[Advance]:
    """Show a bar while the block runs.

    Args:
        progress: Whether to show it; None shows it if stderr is a terminal.
        total: The number of units of the whole task.
        unit: The unit in the plural, such as "rows".
        what: A label before the bar.

    Yields:
        A function that moves the bar by a number of units, which may be negative.
    """
    if not (sys.stderr.isatty() if progress is None else progress):
        yield unseen
        return
    from tqdm.auto import tqdm  # a widget in a notebook, else text

    with tqdm(total=total, desc=what, unit=f" {unit}", unit_scale=True) as shown:
        yield shown.update


class Progress:
    """How far a run is, whose shards are made at the same time, in any order."""

    def __init__(self, shown: bool | None = False) -> None:
        """`shown` is as in `bar`."""
        self._shown = shown
        self._advance: Advance = unseen
        self._lock, self._rows = threading.Lock(), dict[int, int]()

    @contextmanager
    def bar(self, rows: int, done: int) -> Iterator[None]:
        """Show a bar for a number of rows, of which some are made already, while the block runs."""
        with bar(self._shown, rows, "transitions") as self._advance:
            self._advance(done)
            yield

    def reach(self, shard: int, rows: int) -> None:
        """Move the bar to the rows of a shard, by its number, that are made."""
        with self._lock:
            self._advance(rows - self._rows.get(shard, 0))
            self._rows[shard] = rows
