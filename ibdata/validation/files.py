"""Compare the SHA-256 of the files of a dataset with its manifest, and find files that are not listed."""

from __future__ import annotations

import os
from collections.abc import Container, Iterator
from concurrent.futures import ThreadPoolExecutor

from ibdata.dataset.stored import Stored
from ibdata.system.progress import Advance, unseen
from ibdata.validation.rules import Problem

THREADS = os.cpu_count() or 1


def check_files(stored: Stored, advance: Advance = unseen) -> Iterator[Problem]:
    """The listed files that are missing or changed, and files in `data` that are not listed."""
    with Hashing(stored) as files:
        yield from files.problems(advance)
    yield from unlisted_files(stored)


def changed_files(stored: Stored, paths: Container[str]) -> list[Problem]:
    """Those of these listed files that are missing or changed. Raises BusyError if a writer did it."""
    with Hashing(stored, paths) as files:
        problems = list(files.problems())
    if problems:
        stored.refuse_replaced()
    return problems


def unlisted_files(stored: Stored) -> Iterator[Problem]:
    """The files and folders in `data` that a reader would take, but that the manifest does not list."""
    known = stored.manifest.entries()
    for name in stored.storage.names("data"):
        path = f"data/{name.rstrip('/')}"
        if path not in known and _is_read(name):
            what = "folder" if name.endswith("/") else "file"
            message = f"found a {what} that the manifest does not list; move it away"
            yield Problem(path, None, "file", message)


def _is_read(name: str) -> bool:
    """Whether a reader may take a file or folder of this name; polars and duckdb take hidden ones too."""
    return not name.startswith(".") or name.lower().endswith(".parquet") or name.endswith("/")


class Hashing:
    """A context in which threads compute the SHA-256 of listed files, by default of all."""

    def __init__(self, stored: Stored, paths: Container[str] | None = None) -> None:
        entries, storage = stored.manifest.entries(), stored.storage
        self._expected = {path: entries[path] for path in entries if paths is None or path in paths}
        self._todo = "; ibdata repair makes it again" if storage.url is None else ""
        self._threads = ThreadPoolExecutor(THREADS)  # hashing releases the interpreter's lock
        self._found = {path: self._threads.submit(storage.entry, path) for path in self._expected}

    def __enter__(self) -> Hashing:
        return self

    def __exit__(self, *error: object) -> None:
        self._threads.shutdown(cancel_futures=True)

    def is_whole(self, path: str) -> bool:
        """Whether a file is the one that the manifest lists."""
        return self._found[path].result() == self._expected[path]

    def problems(self, advance: Advance = unseen) -> Iterator[Problem]:
        """The files that are missing, and those that have another SHA-256 or size."""
        for path, expected in self._expected.items():
            found = self._found[path].result()
            advance(1)
            if found is None:
                yield Problem(path, None, "file", f"found no file that can be read{self._todo}")
            elif found.sha256 != expected.sha256:
                shown = f"found {found.sha256[:12]}…, expected {expected.sha256[:12]}…"
                yield Problem(path, None, "hash", f"{shown} as the manifest lists{self._todo}")
            elif found != expected:
                shown = f"found {found.bytes} bytes, expected {expected.bytes}"
                yield Problem(path, None, "file", f"{shown} as the manifest lists{self._todo}")
