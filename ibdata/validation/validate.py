"""Check that the files, metadata and rows of a dataset are those that its manifest promises."""

from __future__ import annotations

import os
import time
from collections.abc import Container, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.errors import BusyError, DatasetError
from ibdata.experiment.dataset_spec import spec_in
from ibdata.system import object_store
from ibdata.system.atomic_files import file_sha256
from ibdata.system.lock import is_locked
from ibdata.validation.consistency import check_plan, checks, proven_root
from ibdata.validation.rows import check_shard
from ibdata.validation.rules import Problem
from ibdata.writing.metadata import as_json
from ibdata.writing.shard_writer import WrittenShard
from ibdata.writing.summary import content_of

THREADS = os.cpu_count() or 1
TRIES = 5  # while the dataset is being replaced
LATE = (manifest.CARD, manifest.REPORT)  # in a replacement they take their places after the manifest
PATIENCE = 10.0  # seconds to wait for a writer that is replacing the dataset


def validate(folder: str | os.PathLike[str], quick: bool = False) -> list[Problem]:
    """Find every problem of a dataset, without running any code of the dataset.

    The SHA-256 of every file is compared; then every rule of the rows is checked (schema, no nulls, finite,
    bounds, order, flags, policies, continuity, reward identity, setpoints, steering, operational costs,
    densities), the episode digests, the content root, and whether all other files follow from the experiment
    and the rows. Files that are not listed are problems too, except at a URL.

    Args:
        folder: A folder or a URL.
        quick: Compare only the SHA-256 of the files.

    Returns:
        The problems; none where the dataset is whole.

    Raises:
        BusyError: The dataset was being replaced each time that it was read.
    """
    path = object_store.local_copy(folder)
    for _ in range(TRIES):
        _wait_for_moves(path)
        try:
            listed = manifest.read(path)
        except DatasetError as error:
            return [*_interrupted(path), Problem.of(error, manifest.PATH, path / manifest.PATH, "manifest")]
        try:
            problems = [*_interrupted(path), *_problems(path, listed, quick)]
            manifest.refuse_replaced(path, listed)
        except manifest.ReplacedError:
            continue
        if not problems or not _moving(path):
            return problems
    raise BusyError(f"{object_store.name_of(path)}: being replaced; wait for the writer, then validate again")


def _moving(folder: Path) -> bool:
    """Whether a running process is replacing the dataset right now."""
    return _replacement_begun(folder) and is_locked(folder)


def _wait_for_moves(folder: Path) -> None:
    until = time.monotonic() + PATIENCE
    while _moving(folder) and time.monotonic() < until:
        time.sleep(0.02)


def _replacement_begun(folder: Path) -> bool:
    return os.path.lexists(folder / manifest.NEW / manifest.MARK)


def _interrupted(folder: Path) -> Iterator[Problem]:
    if _replacement_begun(folder) and not is_locked(folder):
        message = f"found a replacement that was interrupted; ibdata repair {folder} finishes it"
        yield Problem(manifest.NEW, None, "unsettled", message)


def _problems(folder: Path, listed: Manifest, quick: bool) -> Iterator[Problem]:
    if manifest.content(folder, manifest.PATH) != as_json(listed):
        message = "found the content in other bytes, expected those that ibdata writes"
        yield Problem(manifest.PATH, None, "manifest", message)
        return
    problems = list(check_files(folder, listed))
    yield from problems
    if not quick:
        late = LATE if _replacement_begun(folder) else ()
        yield from _contents(folder, listed, {*late, *(problem.path for problem in problems)})


def check_files(folder: Path, listed: Manifest) -> Iterator[Problem]:
    """The listed files that are missing or changed, and files in `data` that are not listed."""
    late = LATE if _replacement_begun(folder) else ()
    entries = [entry for entry in listed.files if entry.path not in late]
    paths = [manifest.locate(folder, entry.path) for entry in entries]
    with ThreadPoolExecutor(THREADS) as threads:  # hashing lets go of Python's lock
        hashes = list(threads.map(file_sha256, paths))
    for entry, found in zip(entries, hashes, strict=True):
        if found is None:
            yield Problem(entry.path, None, "file", "found no file that can be read; ibdata repair makes it")
        elif found != entry.sha256:
            message = f"found {found[:12]}…, expected {entry.sha256[:12]}… as the manifest lists"
            yield Problem(entry.path, None, "hash", message)
    if _replacement_begun(folder):
        return  # files in data/ may be those of the new dataset
    for path in strangers(folder, listed.entries()):
        what = "folder" if path.is_dir() else "file"
        message = f"found a {what} that the manifest does not list; move it away"
        yield Problem(f"data/{path.name}", None, "file", message)


def strangers(folder: Path, known: Container[str]) -> Iterator[Path]:
    """What is in `data`, is not among these paths, and could be read with the dataset."""
    for path in sorted((folder / "data").glob("*")):
        if f"data/{path.name}" not in known and is_stranger(path):
            yield path


def is_stranger(path: Path) -> bool:
    """Whether a reader may take what has such a name; polars and duckdb take hidden Parquet and folders."""
    hidden = path.name.startswith(".")
    return not hidden or path.name.lower().endswith(".parquet") or path.is_dir()


def _contents(folder: Path, listed: Manifest, damaged: set[str]) -> Iterator[Problem]:
    try:
        spec = spec_in(folder, listed)
    except DatasetError as error:
        yield Problem.of(error, manifest.PATH, folder / manifest.PATH, "manifest")
        return
    plan = list(check_plan(spec, listed))
    yield from plan
    if any(problem.rule in ("experiments", "files") for problem in plan):
        return
    written: list[WrittenShard] = []
    entries = listed.entries()
    for shard, one in zip(spec.shards, listed.shards, strict=True):
        if one.path in damaged:
            continue
        content, problems = check_shard(spec, shard, manifest.locate(folder, one.path), one.path)
        yield from problems
        if content is not None:
            written.append(WrittenShard(shard, entries[one.path], content))
            if content_of(content.digests) != one.content:
                message = "found other content than the manifest lists"
                yield Problem(one.path, None, "digest", message)
    root = proven_root(spec, listed, written)
    if root != listed.content_root:
        message = f"found {listed.content_root}, expected {root}"
        yield Problem(manifest.PATH, None, "content root", message)
    for path, check in checks(folder, listed, spec, written, root):
        if path not in damaged:
            yield from _read(folder, path, check)


def _read(folder: Path, path: str, check: Iterator[Problem]) -> Iterator[Problem]:
    """The problems that a check finds; one where it cannot read its file."""
    try:
        yield from check
    except manifest.ReplacedError:
        raise
    except DatasetError as error:
        yield Problem.of(error, path, folder / path, "metadata")
