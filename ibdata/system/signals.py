"""Signals that ask to stop, as exceptions, so that every `finally` runs."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from ibdata.errors import Interrupted

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_arrived: list[int] = []
_held: list[int] = []  # an entry for each `held` that is entered


def check() -> None:
    """Raise Interrupted for a signal that arrived where exceptions are swallowed, as in callbacks from C."""
    if _arrived:
        raise Interrupted(_arrived[0])


@contextmanager
def held() -> Iterator[None]:
    """Make signals wait until the block ends, also for processes that it starts.

    A mask is not enough: another thread, of a library, may take the signal, and Python's handler runs here.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
    _held.append(0)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        _held.pop()
        if not _held:
            check()


@contextmanager
def stoppable() -> Iterator[None]:
    """Raise Interrupted where SIGINT, SIGTERM or SIGHUP arrive; in the main thread only, as Python has it.

    A second signal, during the cleaning up, is ignored: what is left to do is short.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in STOPPING}

    def stop(number: int, frame: FrameType | None) -> None:
        for other in STOPPING:
            signal.signal(other, signal.SIG_IGN)
        _arrived.append(number)
        if not _held:
            raise Interrupted(number)

    for number, handler in before.items():
        if handler is not signal.SIG_IGN:  # nohup, or a shell's background job
            signal.signal(number, stop)
    try:
        yield
    except Exception as error:
        if _arrived and not isinstance(error, Interrupted):  # some code takes every error for its own
            raise Interrupted(_arrived[0]) from error
        raise
    finally:
        _arrived.clear()
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
