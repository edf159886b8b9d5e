"""A line on stderr whenever compiling makes somebody wait."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from ibdata.system.cache_folders import cache_folders

PAUSE = 5.0  # seconds without compiling, after which another line is due


class Announcement:
    """Says that functions are being compiled, once for those that are compiled one after another."""

    def __init__(self) -> None:
        self._under_way = 0  # functions that are being compiled, each for the one before it
        self._last = float("-inf")

    def begin(self) -> None:
        """Note that a function is about to be compiled."""
        if not self._under_way and time.monotonic() - self._last > PAUSE:
            print(f"ibdata: {_text()}", file=sys.stderr, flush=True)
        self._under_way += 1

    def end(self) -> None:
        """Note that the function has been compiled."""
        self._under_way -= 1
        self._last = time.monotonic()


def _text() -> str:
    """What is compiled, how long it takes, and how often."""
    places = cache_folders()
    what, duration = "the simulator", "up to 30 seconds"
    if any(any(Path(folder, "numba").glob("*.nbc")) for folder in places.folders):
        what, duration = "a part of the simulator that was not used before", "a few seconds"
    if places.lasting:
        return f"compiling {what}; this happens once and takes {duration}"
    return (
        f"compiling {what}; this takes {duration} in every run, because no cache folder can be "
        "written to; set IBDATA_CACHE_DIR to one"
    )
