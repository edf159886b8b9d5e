"""Compare the SHA-256 of the files of a dataset with its manifest, and find files that are not listed."""

from __future__ import annotations

import os
from collections.abc import Container, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.dataset.strangers import strangers
from ibdata.system.progress import Advance, unseen
from ibdata.system.storage import storage
from ibdata.validation.rules import Problem

THREADS = os.cpu_count() or 1


def check_files(place: Any, listed: Manifest, advance: Advance = unseen) -> Iterator[Problem]:
    """The listed files that are missing or changed, and files in `data` that are not listed."""
    with Hashing(place, listed) as files:
        yield from files.problems(advance)
    yield from unlisted_files(place, listed)


def changed_files(place: Any, listed: Manifest, paths: Container[str]) -> list[Problem]:
    """Those of these listed files that are missing or changed. Raises BusyError if it was replaced."""
    with Hashing(place, listed, paths) as files:
        problems = list(files.problems())
    if problems:
        manifest.refuse_replaced(place, listed)
    return problems


def unlisted_files(place: Any, listed: Manifest) -> Iterator[Problem]:
    """The files and folders in `data` that a reader would take, but that the manifest does not list."""
    for path in strangers(place, listed.entries()):
        what = "folder" if path.endswith("/") else "file"
        message = f"found a {what} that the manifest does not list; move it away"
        yield Problem(path.rstrip("/"), None, "file", message)


class Hashing:
    """A context in which threads compute the SHA-256 of listed files, by default of all."""

    def __init__(self, place: Any, listed: Manifest, paths: Container[str] | None = None) -> None:
        self._expected = {
            file.path: file.sha256 for file in listed.files if paths is None or file.path in paths
        }
        self._files = storage(place)
        self._threads = ThreadPoolExecutor(THREADS)  # hashing releases the interpreter's lock
        self._found = {path: self._threads.submit(self._files.sha256, path) for path in self._expected}

    def __enter__(self) -> Hashing:
        return self

    def __exit__(self, *error: object) -> None:
        self._threads.shutdown(cancel_futures=True)

    def is_whole(self, path: str) -> bool:
        """Whether a file has the SHA-256 that the manifest lists."""
        return self._found[path].result() == self._expected[path]

    def problems(self, advance: Advance = unseen) -> Iterator[Problem]:
        """The files that are missing, and those that have another SHA-256."""
        for path, expected in self._expected.items():
            found = self._found[path].result()
            advance(1)
            if found is None:
                todo = "; ibdata repair makes it" if self._files.url is None else ""
                yield Problem(path, None, "file", f"found no file that can be read{todo}")
            elif found != expected:
                message = f"found {found[:12]}…, expected {expected[:12]}… as the manifest lists"
                yield Problem(path, None, "hash", message)
