"""Check that the files, rows and metadata of a dataset are those that its manifest promises."""

from __future__ import annotations

import os
from collections.abc import Container, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager

from ibdata._numerics.arguments import public
from ibdata._system.processes import available_processors
from ibdata._system.progress import Advance, bar, unseen
from ibdata._system.storage import existing, storage
from ibdata.dataset import manifest
from ibdata.dataset.stored import Stored
from ibdata.errors import DatasetError
from ibdata.generation.finish import plan_problems
from ibdata.generation.shard import WrittenShard
from ibdata.plan.dataset_spec import declared_spec
from ibdata.tools.checks import check_shard, metadata_problems, root_problems, splits_problems
from ibdata.tools.rules import Findings, Problem


@public
def validate(
    folder: str | os.PathLike[str], quick: bool = False, *, progress: bool | None = False
) -> Findings:
    """Find every problem of a dataset, without running any code of the dataset.

    1. The SHA-256 of every file that the manifest lists is compared. Other files in `data` are problems too.
    2. Every row is checked by the rules: schema, no nulls, finite, bounds, indices, flags, policy,
       continuity, reward, setpoint, steering, shift register, density, expert action.
    3. The digests of the episodes and the content root are computed again from the rows, and compared.
    4. So is what follows from the experiments and the rows: shards, columns, counts, splits, table of
       episodes, statistics. Values are compared, not bytes.

    README.md must be there, for `datasets.load_dataset`. It and report.html are yours to edit: what they say
    is not checked.

    Args:
        folder: A folder or a URL, as in `open`.
        quick: Compare only the SHA-256 of the files, and the splits, whose file has none.
        progress: Whether to show a bar on stderr; None shows it if stderr is a terminal.

    Returns:
        The problems, a list that is empty if there are none, and that notebooks show as a table.

    Raises:
        BusyError: The dataset was replaced while it was read.
    """
    place = storage(existing(folder))
    try:
        stored = Stored.open(place)
    except DatasetError as error:
        return Findings([Problem.of(error, manifest.PATH, place.where(manifest.PATH), "manifest")])
    problems = Findings()
    if quick:
        with Hashing(stored) as files, bar(progress, len(stored.manifest.files), "files") as advance:
            problems += files.problems(advance)
        problems += [*unlisted_files(stored), *splits_problems(stored), *card_problems(stored)]
    else:
        with Hashing(stored) as files, bar(progress, stored.manifest.rows, "rows") as advance:
            contents = list(_contents(stored, files, advance))
            problems += files.problems()
        problems += [*unlisted_files(stored), *card_problems(stored), *contents]
    stored.refuse_replaced()
    return problems


def _contents(stored: Stored, files: Hashing, advance: Advance) -> Iterator[Problem]:
    """The problems with what whole files hold."""
    listed = stored.manifest
    try:
        spec = declared_spec(stored)
    except DatasetError as error:
        yield Problem.of(error, manifest.PATH, stored.storage.where(manifest.PATH), "manifest")
        return
    plan = [Problem(manifest.PATH, None, rule, message) for rule, message in plan_problems(spec, listed)]
    yield from plan
    if any(problem.rule in ("experiments", "files") for problem in plan):
        return
    entries, written = listed.entries(), list[WrittenShard]()
    for shard, one in zip(spec.shards, listed.shards, strict=True):
        summary, problems = check_shard(spec, shard, stored.storage, one.path, advance)
        if not files.is_whole(one.path):  # asked now, so that the file is hashed meanwhile
            continue
        yield from problems
        if summary is not None:
            written.append(WrittenShard(shard, entries[one.path], summary))
            if summary.content != one.content:
                yield Problem(one.path, None, "digest", "found other content than the manifest lists")
    if len(written) == len(spec.shards):
        yield from root_problems(spec, listed, ((w.shard, w.summary.digests) for w in written))
    yield from metadata_problems(stored, spec, written, files.is_whole)
    yield from splits_problems(stored)


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
        is_folder = name.endswith("/")
        is_read = is_folder or not name.startswith(".") or name.lower().endswith(".parquet")
        if is_read and path not in known:  # polars and duckdb read hidden files, too
            what = "folder" if is_folder else "file"
            message = f"found a {what} that the manifest does not list; move it away"
            yield Problem(path, None, "file", message)


def card_problems(stored: Stored) -> Iterator[Problem]:
    """Whether there is a card: only its front matter says that the files in `meta` are no rows."""
    try:
        stored.storage.open(manifest.CARD).close()
    except OSError:
        message = f"found no file that can be read, which load_dataset needs{remedy(stored)}"
        yield Problem(manifest.CARD, None, "file", message)


def remedy(stored: Stored) -> str:
    """The end of a message that says what makes a file again; nothing does at a URL."""
    return "; ibdata repair makes it again" if stored.storage.url is None else ""


class Hashing(AbstractContextManager["Hashing"]):
    """A context in which threads compute the SHA-256 of listed files, by default of all."""

    def __init__(self, stored: Stored, paths: Container[str] | None = None) -> None:
        entries, storage = stored.manifest.entries(), stored.storage
        self._expected = {path: entries[path] for path in entries if paths is None or path in paths}
        self._todo = remedy(stored)
        self._threads = ThreadPoolExecutor(available_processors())  # hashing releases the interpreter's lock
        self._found = {path: self._threads.submit(storage.entry, path) for path in self._expected}

    def __exit__(self, *error: object) -> None:
        self._threads.shutdown(cancel_futures=True)

    def is_whole(self, path: str) -> bool:
        """Whether a file is the one that the manifest lists."""
        return self._found[path].result() == self._expected[path]

    def problems(self, advance: Advance = unseen) -> Iterator[Problem]:
        """The files that are missing, and those that have another SHA-256 or size."""
        for path, expected in self._expected.items():
            entry = self._found[path].result()
            advance(1)
            if entry is None:
                yield Problem(path, None, "file", f"found no file that can be read{self._todo}")
            elif entry.sha256 != expected.sha256:
                shown = f"found {entry.sha256[:12]}…, expected {expected.sha256[:12]}…"
                yield Problem(path, None, "hash", f"{shown} as the manifest lists{self._todo}")
            elif entry != expected:
                shown = f"found {entry.bytes} bytes, expected {expected.bytes}"
                yield Problem(path, None, "file", f"{shown} as the manifest lists{self._todo}")
