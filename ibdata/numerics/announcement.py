"""A line on stderr when compiling makes somebody wait, and in a terminal how far it is."""

from __future__ import annotations

import sys
from pathlib import Path

from ibdata.system.cache_folders import cache_folders


class Announcement:
    """Says once in a process that functions are being compiled, and counts them while they are."""

    def __init__(self) -> None:
        self._under_way = 0  # functions that are being compiled, each for the one before it
        self._made = 0
        self._said = False

    def begin(self, module: str) -> None:
        """Note that a function of a module is about to be compiled."""
        if not self._said:
            print(f"ibdata: {_text(module)}", file=sys.stderr, flush=True)
            self._said = True
        self._under_way += 1

    def end(self) -> None:
        """Note that the function has been compiled."""
        self._under_way -= 1
        self._made += 1
        if sys.stderr.isatty():
            counted = f"ibdata: functions compiled: {self._made}" if self._under_way else ""
            print(f"\r\033[K{counted}", end="", file=sys.stderr, flush=True)


def _text(module: str) -> str:
    """What is compiled, how long it takes, and how often."""
    places = cache_folders()
    what, duration = "the simulator", "about 10 seconds"
    if any(any(Path(folder, "numba").glob("*.nbc")) for folder in places.folders):
        what, duration = f"{module}, which was not used before", "a few seconds"
        if places.lasting:
            return f"compiling {what}; this takes {duration}"
    if places.lasting:
        return f"compiling {what}; this happens once and takes {duration}"
    return (
        f"compiling {what}; this takes {duration} in every run, because no cache folder can be "
        "written to; set IBDATA_CACHE_DIR to one"
    )
