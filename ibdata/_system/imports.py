"""Importing libraries that look for a configuration in the current folder, which may be somebody else's."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_file(name: str) -> Iterator[None]:
    """A context in which a library that is imported finds no file of this name in the current folder."""
    exists = os.path.exists
    os.path.exists = lambda path: path != name and exists(path)
    try:
        yield
    finally:
        os.path.exists = exists
