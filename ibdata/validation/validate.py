"""Check that the files, metadata and rows of a dataset are those that its manifest promises."""

from __future__ import annotations

import os
from collections.abc import Container, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.errors import BusyError, DatasetError
from ibdata.experiment.dataset_spec import spec_in
from ibdata.system.progress import Advance, bar, unseen
from ibdata.system.storage import is_url, storage
from ibdata.validation.consistency import check_plan, checks, proven_root
from ibdata.validation.rows import check_shard
from ibdata.validation.rules import Findings, Problem
from ibdata.writing.metadata import as_json
from ibdata.writing.shard_writer import WrittenShard
from ibdata.writing.summary import content_of

THREADS = os.cpu_count() or 1
Hashes = dict[str, "Future[str | None]"]  # the SHA-256 of files, by path


def validate(
    folder: str | os.PathLike[str], quick: bool = False, *, progress: bool | None = False
) -> Findings:
    """Find every problem of a dataset, without running any code of the dataset.

    First, the SHA-256 of every file is compared. Then every rule of the rows is checked (schema, no nulls,
    finite, bounds, order, flags, policies, continuity, reward identity, setpoints, steering, operational
    costs, densities), and the episode digests and the content root are compared. All other files must follow
    from the experiment and the rows. Files in `data` that are not listed are problems too.

    Args:
        folder: A folder or a URL.
        quick: Compare only the SHA-256 of the files.
        progress: Whether to show a bar on stderr; None shows it if stderr is a terminal.

    Returns:
        The problems, a list that is empty if there are none, and that notebooks show as a table.

    Raises:
        BusyError: The dataset was replaced while it was read.
    """
    files = storage(folder)
    try:
        listed = manifest.read(files)
    except DatasetError as error:
        return Findings([Problem.of(error, manifest.PATH, files.where(manifest.PATH), "manifest")])
    problems = Findings(_problems(files, listed, quick, progress))
    manifest.refuse_replaced(files, listed)
    return problems


def _problems(folder: Any, listed: Manifest, quick: bool, progress: bool | None) -> Iterator[Problem]:
    if storage(folder).read(manifest.PATH) != as_json(listed):
        message = "found other bytes than ibdata writes for this content"
        yield Problem(manifest.PATH, None, "manifest", message)
        return
    with _hashing(folder, listed) as hashes:  # meanwhile the rows are checked
        if quick:
            with bar(progress, len(hashes), "files") as advance:
                yield from _wrong_files(folder, listed, hashes, advance)
            return
        with bar(progress, listed.rows, "rows") as advance:
            contents = list(_contents(folder, listed, hashes, advance))
        yield from _wrong_files(folder, listed, hashes)
    yield from contents


@contextmanager
def _hashing(folder: Any, listed: Manifest, only: Container[str] | None = None) -> Iterator[Hashes]:
    """The SHA-256 of the listed files, made in threads; hashing releases the interpreter's lock."""
    paths = [path for path in listed.entries() if only is None or path in only]
    files = storage(folder)
    with ThreadPoolExecutor(THREADS) as threads:
        try:
            yield {path: threads.submit(files.sha256, path) for path in paths}
        finally:
            threads.shutdown(cancel_futures=True)


def wrong_files(folder: Any, listed: Manifest, paths: Container[str]) -> list[Problem]:
    """Those of these listed files that are missing or changed. Raises ReplacedError as `listed_content`."""
    with _hashing(folder, listed, paths) as hashes:
        problems = list(_changed(folder, listed, hashes))
    if problems:
        manifest.refuse_replaced(folder, listed)
    return problems


def check_files(folder: Any, listed: Manifest) -> Iterator[Problem]:
    """The listed files that are missing or changed, and files in `data` that are not listed."""
    with _hashing(folder, listed) as hashes:
        yield from _wrong_files(folder, listed, hashes)


def _changed(folder: Any, listed: Manifest, hashes: Hashes, advance: Advance = unseen) -> Iterator[Problem]:
    known = listed.entries()
    for path, future in hashes.items():
        found, expected = future.result(), known[path].sha256
        advance(1)
        if found is None:
            todo = "" if is_url(folder) else "; ibdata repair makes it"
            yield Problem(path, None, "file", f"found no file that can be read{todo}")
        elif found != expected:
            message = f"found {found[:12]}…, expected {expected[:12]}… as the manifest lists"
            yield Problem(path, None, "hash", message)


def _wrong_files(
    folder: Any, listed: Manifest, hashes: Hashes, advance: Advance = unseen
) -> Iterator[Problem]:
    yield from _changed(folder, listed, hashes, advance)
    for name in storage(folder).names("data"):
        if f"data/{name}" not in listed.entries() and is_stranger(Path(name), name.endswith("/")):
            what = "folder" if name.endswith("/") else "file"
            message = f"found a {what} that the manifest does not list; move it away"
            yield Problem(f"data/{name}".rstrip("/"), None, "file", message)


def strangers(folder: Path, known: Container[str]) -> Iterator[Path]:
    """The files and folders in `data` that are not among these paths and that a reader could take."""
    for path in sorted((folder / "data").glob("*")):
        if f"data/{path.name}" not in known and is_stranger(path):
            yield path


def is_stranger(path: Path, folder: bool | None = None) -> bool:
    """Whether a reader may take a file or folder of this name; polars and duckdb take hidden ones too."""
    hidden = path.name.startswith(".")
    is_dir = path.is_dir() if folder is None else folder
    return not hidden or path.name.lower().endswith(".parquet") or is_dir


def _contents(folder: Any, listed: Manifest, hashes: Hashes, advance: Advance) -> Iterator[Problem]:
    """The problems with what whole files hold."""
    entries = listed.entries()

    def damaged(path: str) -> bool:
        return path not in hashes or hashes[path].result() != entries[path].sha256

    try:
        spec = spec_in(folder, listed)
    except DatasetError as error:
        yield Problem.of(error, manifest.PATH, storage(folder).where(manifest.PATH), "manifest")
        return
    plan = list(check_plan(spec, listed))
    yield from plan
    if any(problem.rule in ("experiments", "files") for problem in plan):
        return
    written: list[WrittenShard] = []
    for shard, one in zip(spec.shards, listed.shards, strict=True):
        try:
            content, problems = check_shard(spec, shard, folder, one.path, advance)
        except Exception:  # whatever a damaged file leads to
            if not damaged(one.path):
                raise
        if damaged(one.path):
            continue
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
        if not damaged(path):
            yield from _read(folder, path, check)


def _read(folder: Any, path: str, check: Iterator[Problem]) -> Iterator[Problem]:
    """Yield the problems that a check finds, or one problem if it cannot read its file."""
    try:
        yield from check
    except BusyError:
        raise
    except DatasetError as error:
        yield Problem.of(error, path, storage(folder).where(path), "metadata")
