"""The folders in which the code of custom policies and the files that it reads are looked for."""

from __future__ import annotations

import filecmp
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from ibdata.errors import UsageError, printable

# Where code is looked for: the current folder at the start of a run, and the folder of its YAML file.
_places: ContextVar[tuple[Path, ...]] = ContextVar("places", default=())


def code_places() -> tuple[Path, ...]:
    """The current folder at the start of the run, then the folder of the experiment's YAML file, if any."""
    return _places.get() or (Path.cwd(),)


def two_places(here: str | Path, folder: Path | None) -> tuple[Path, ...]:
    """The folder in which a run begins, and that of its YAML file if there is one and it is another."""
    return tuple(dict.fromkeys([Path(here), *([] if folder is None else [folder.absolute()])]))


def look_in(here: str | Path, folder: Path | None) -> None:
    """Look for code in the folder in which the run began, and in that of its YAML file, from now on."""
    _places.set(two_places(here, folder))


@contextmanager
def looking_in(folder: Path | None) -> Iterator[None]:
    """A context in which code is looked for in the current folder and in that of a YAML file."""
    before = _places.get()
    look_in(Path.cwd(), folder)
    try:
        yield
    finally:
        _places.set(before)


@contextmanager
def looking_here() -> Iterator[None]:
    """A context in which code is looked for in the current folder, whatever code changes it in between."""
    if _places.get():
        yield
        return
    with looking_in(None):
        yield


def located(name: str, what: str, places: tuple[Path, ...]) -> Path:
    """Return the path of a file that is named relative to the YAML file or to the current folder.

    Raises UsageError, which begins with `what`, where there is none, or two that differ.
    """
    paths = dict.fromkeys(place / name for place in reversed(places))
    found = [path for path in paths if path.is_file()]
    if not found:
        named = printable(" or ".join(map(str, paths)))
        raise UsageError(
            f"{what}: found no file {printable(name)!r}, expected it beside the experiment's YAML file or in "
            f"the current folder: {named}; copy it there, or go to the folder in which it is"
        )
    if len(found) > 1 and not filecmp.cmp(found[0], found[1], shallow=False):
        raise UsageError(
            f"{what}: found {printable(' and '.join(map(str, found)))}, which differ, so nobody knows which "
            "of the two is read; remove one"
        )
    return found[0]


def import_from(folders: tuple[Path, ...]) -> None:
    """Make modules of these folders importable, before all others, as `python -m` does."""
    for folder in reversed(folders):
        if str(folder) in sys.path:
            sys.path.remove(str(folder))
        sys.path.insert(0, str(folder))
