"""The processors of this machine, and the purpose of this process."""

from __future__ import annotations

import os
from typing import Literal

# A session of Python's; or a process of ibdata's own, which has no other purpose.
purpose: Literal["session", "command", "worker"] = "session"


def available_processors() -> int:
    """The number of processors that this process may use, else that the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
