"""Turning signals that ask to stop into exceptions, so that every `finally` runs."""

from __future__ import annotations

import signal
import sys
import threading
import time
from _thread import start_new_thread
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib import _bootstrap
from types import FrameType
from typing import Any

from ibdata.errors import Interrupted

# Windows has no SIGHUP, but SIGBREAK for Ctrl-Break; it has no mask of signals either.
STOPPING = [each for each in signal.Signals if each.name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")]
Handler = Callable[[int, FrameType | None], Any]

_arrived: list[int] = []
_held: list[int] = []  # one entry for each block of `held` that has not ended
_waiting: set[int] = set()  # those that came during an import, or whose exception may be lost in C++


def check() -> None:
    """Raise Interrupted for a signal that arrived where exceptions are lost, such as in a callback from C."""
    if _arrived:
        raise Interrupted(_arrived[0])


@contextmanager
def held() -> Iterator[None]:
    """Delay signals until the block ends, also in processes that it starts.

    A signal mask is not enough, because a library's thread may receive the signal, and Python then calls the
    handler in the main thread.
    """
    before = _mask("SIG_BLOCK", STOPPING)
    _held.append(0)
    try:
        yield
    finally:
        _mask("SIG_SETMASK", before)
        _held.pop()
        if not _held:
            check()


def ignore() -> None:
    """Ignore the signals until `stoppable` ends: what is left to do is short."""
    if threading.current_thread() is threading.main_thread():
        for number in STOPPING:
            signal.signal(number, signal.SIG_IGN)


def leave_to_parent() -> None:
    """Ignore what a terminal sends to every process, and take what the parent has blocked, in its child."""
    for number in STOPPING:
        if number != signal.SIGTERM:
            signal.signal(number, signal.SIG_IGN)
    _mask("SIG_UNBLOCK", [signal.SIGTERM])


def _mask(how: str, numbers: Iterable[int]) -> Iterable[int]:
    change = getattr(signal, "pthread_sigmask", None)
    return change(getattr(signal, how), numbers) if change else ()


@contextmanager
def stoppable() -> Iterator[None]:
    """Raise Interrupted when SIGINT, SIGTERM or SIGHUP arrives. Does nothing outside the main thread.

    A second signal is ignored, because cleaning up does not take long.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in STOPPING}

    def stop(number: int, frame: FrameType | None) -> None:
        ignore()
        _arrived.append(number)
        if not _held:
            raise Interrupted(number)

    try:
        for number, handler in before.items():
            if handler is not signal.SIG_IGN:  # as under nohup, or in a shell's background job
                signal.signal(number, _after_imports(stop))
        yield
    except BaseException as error:
        _waiting.difference_update(_arrived)
        if _arrived and isinstance(error, Exception):  # some code turned Interrupted into an error of its own
            raise Interrupted(_arrived[0]) from error
        raise
    finally:
        _arrived.clear()
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)


@contextmanager
def whole_imports() -> Iterator[None]:
    """Let Ctrl-C wait until an import has ended. Does nothing outside the main thread.

    Many libraries cannot be imported again once their import was interrupted, and Arrow, which imports pandas
    from C++, loses the interruption.
    """
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield
        return
    signal.signal(signal.SIGINT, _after_imports(handler))
    try:
        yield
    except KeyboardInterrupt:
        _waiting.clear()
        raise
    finally:
        signal.signal(signal.SIGINT, handler)
        if signal.SIGINT in _waiting:
            _waiting.clear()
            handler(signal.SIGINT, None)


def _after_imports(handler: Handler) -> Handler:
    """A handler to which a signal comes when no import that begins from now on is under way."""
    begun = _imports(sys._getframe())

    def wait(number: int, frame: FrameType | None) -> None:
        _waiting.add(number)
        if _imports(frame) > begun:
            start_new_thread(_send_again, (number,))  # threading has a lock, which this thread may hold
        else:
            handler(number, frame)
            _waiting.discard(number)

    return wait


def _imports(frame: FrameType | None) -> int:
    count = 0
    while frame:
        count += frame.f_globals is _bootstrap.__dict__
        frame = frame.f_back
    return count


def _send_again(number: int) -> None:
    time.sleep(0.02)
    if number in _waiting:
        if send := getattr(signal, "pthread_kill", None):  # ends waiting for a lock; Windows lacks it
            send(threading.main_thread().ident, number)
        else:
            signal.raise_signal(number)
