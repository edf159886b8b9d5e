"""The processors of this machine."""

from __future__ import annotations

import os


def available_processors() -> int:
    """The number of processors that this process may use, else that the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
