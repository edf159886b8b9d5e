"""The processors of this machine, and what is known of this process."""

from __future__ import annotations

import os
from contextvars import ContextVar
from typing import Literal

# A session of Python's; or a process of ibdata's own, which has no other purpose.
purpose: Literal["session", "command", "worker"] = "session"
known_before: set[str] = set()  # the modules of this process before it first imported custom code
loading: ContextVar[tuple[str, ...]] = ContextVar("loading", default=())  # targets of custom code, now


def available_processors() -> int:
    """The number of processors that this process may use, else that the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
