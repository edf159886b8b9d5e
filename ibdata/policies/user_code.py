"""Errors in code that is not part of ibdata, told in one line with the file and the line of that code."""

from __future__ import annotations

import os
import sysconfig
import traceback
from pathlib import Path

INSTALLED = {"site-packages", "dist-packages"}
STANDARD = Path(sysconfig.get_path("stdlib"))
PACKAGE = Path(__file__).parents[1]
LONGEST = 300  # characters of an error's own text


def is_installed(path: Path) -> bool:
    """Whether a file is part of Python or of an installed package."""
    return _is_of_others(path) or is_of_python(path)


def is_of_python(path: Path) -> bool:
    """Whether a file is part of Python itself."""
    return path.is_relative_to(STANDARD) and not _is_of_others(path)


def _is_of_others(path: Path) -> bool:
    return bool(INSTALLED & set(path.parts))


def told(error: BaseException) -> str:
    """Return an error as `my_policy.py:12: IndexError: its text`, in one line.

    The place is the innermost line of the user's own files, else of an installed package. An error without
    such a line, as in ibdata itself, is told without a place.
    """
    text = " ".join((error.msg if isinstance(error, SyntaxError) else str(error)).split())
    name = type(error).__name__
    return f"{_place(error)}{name}: {text[:LONGEST]}" if text else f"{_place(error)}{name}"


def _place(error: BaseException) -> str:
    lines = [(frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(error.__traceback__)]
    if isinstance(error, SyntaxError) and error.filename:
        lines.append((error.filename, error.lineno or 1))
    lines = [(file, line) for file, line in lines if not Path(file).is_relative_to(PACKAGE)]
    others = [(file, line) for file, line in lines if _is_of_others(Path(file))]
    own = [
        (file, line) for file, line in lines if not (is_installed(Path(file)) or file.startswith("<frozen"))
    ]
    on_disk = [(file, line) for file, line in own if os.path.isfile(file)]
    for file, line in reversed(on_disk or own or others):
        return f"{_shown(file)}:{line}: "
    return ""


def _shown(file: str) -> str:
    """A path, relative if the file is in the current folder."""
    try:
        inside = os.path.relpath(file)
    except (OSError, ValueError):  # the current folder was removed
        return file
    return file if inside.startswith("..") or file.startswith("<") else inside
