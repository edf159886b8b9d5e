"""The datasets below a folder or a URL, finished or not."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from ibdata._numerics.naming import counted, exact, size
from ibdata._system.part import RUN
from ibdata._system.runs import FolderRun, Run
from ibdata._system.storage import Remote, Storage, local, url_of
from ibdata.dataset import manifest
from ibdata.dataset.stored import Stored
from ibdata.dataset.tabular import Table, Tabular
from ibdata.errors import DatasetError, IbdataError, UsageError
from ibdata.generation.record import Record
from ibdata.plan.dataset_spec import DatasetSpec, declared_spec

COLUMNS = ("dataset", "rows", "bytes", "setpoints", "policies", "content", "state")
MOST_NAMES = 3  # of setpoints or policies that are shown


class Listed(NamedTuple):
    """A dataset, finished or not.

    `state` is finished, "unfinished, n of m shards" or unreadable. The path of an unfinished one is the
    hidden folder of its run. `rows` and `content_root` are None unless the manifest tells them.
    """

    path: Path | str
    state: str
    name: str | None
    rows: int | None
    setpoints: list[float]
    policies: list[str]
    bytes: int
    content_root: str | None

    def plain(self) -> dict[str, Any]:
        """The fields as plain data for JSON."""
        return {**self._asdict(), "path": str(self.path)}


class Listing(Tabular, list[Listed]):
    """The datasets in a folder or at a URL, and below it."""

    def __init__(self, folder: str, datasets: Iterable[Listed]) -> None:
        super().__init__(datasets)
        self.folder = folder

    def plain(self) -> dict[str, Any]:
        """The datasets as plain data for JSON."""
        return {"datasets": [dataset.plain() for dataset in self]}

    def tables(self) -> list[Table]:
        """A row for each dataset, and their sum."""
        if not self:
            line = "no datasets here or below; ibdata generate --config random.yaml makes one"
            return [Table((), (), [f"{self.folder}: {line}"])]
        rows, data_bytes = sum(dataset.rows or 0 for dataset in self), sum(dataset.bytes for dataset in self)
        total = f"{self.folder}: {counted(len(self), 'dataset')}, {counted(rows, 'row')}, {size(data_bytes)}"
        return [Table(COLUMNS, list(map(_row, self)), [total])]


def _row(dataset: Listed) -> tuple[object, ...]:
    return (
        str(dataset.path),
        dataset.rows,
        size(dataset.bytes),
        _some([exact(setpoint) for setpoint in dataset.setpoints]),
        _some(dataset.policies),
        dataset.content_root[:8] if dataset.content_root else None,
        dataset.state,
    )


def _some(names: Sequence[str]) -> str | None:
    if len(names) > MOST_NAMES:
        return f"{names[0]} … {names[-1]} ({len(names):,})"
    return ", ".join(names) or None


def datasets_in(folder: str | os.PathLike[str]) -> Listing:
    """List the datasets in a folder and below it, in the order of their paths.

    Links to folders are followed, hidden folders are not. No code of a dataset runs.

    Args:
        folder: The folder, or a URL; it may itself be a dataset.

    Raises:
        UsageError: There is no such folder or bucket.
    """
    if url := url_of(folder):
        files = Remote(url)
        datasets = [*_unfinished_at(files), *_in_store(files)]
        if not datasets and not files.exists:
            raise UsageError(f"{files.name}: found nothing here, expected a bucket to look for datasets in")
        return Listing(files.name, datasets)
    root = local(folder)
    if not os.path.isdir(root):
        raise UsageError(f"{root}: found no folder here, expected one to look for datasets in")
    return Listing(str(folder), sorted(_listed(root)))


def _unfinished_at(files: Storage) -> list[Listed]:
    return [_unfinished(run) for run in manifest.unfinished(files)]


def _in_store(files: Remote) -> Iterator[Listed]:
    """What is at a URL and below it; nothing inside a dataset is looked at."""
    names = files.names("")
    if "meta/" in names and files.size(manifest.PATH) is not None:
        yield _finished(files)
        return
    for name in (name.rstrip("/") for name in names if name.endswith("/") and name != "/"):
        if name.startswith(".") and name.endswith(".part"):
            yield from _unfinished_at(files.below(name[1:].removesuffix(".part")))
        elif not name.startswith("."):
            yield from _in_store(files.below(name))


def _listed(root: Path) -> Iterator[Listed]:
    """What is in a folder and below it; nothing inside a dataset is looked at."""
    seen = {os.path.realpath(root)}  # a link may lead to a folder above it
    for place, below, _ in os.walk(root, followlinks=True):
        for name in below:
            if name.startswith(".") and name.endswith(".part"):
                run = FolderRun(Path(place, name, RUN))
                with suppress(OSError):  # not ours to read
                    if manifest.is_unfinished(run, Storage(Path(place, name[1:].removesuffix(".part")))):
                        yield _unfinished(run)
        below[:] = [
            name for name in below if not name.startswith(".") and _is_new(root, Path(place, name), seen)
        ]
        if os.path.isfile(os.path.join(place, manifest.PATH)):
            below.clear()
            yield _finished(Storage(place))


def _is_new(root: Path, folder: Path, seen: set[str]) -> bool:
    """Whether a folder was not looked at before, and is no link to one that is found without it."""
    real = os.path.realpath(folder)
    if real in seen or (folder.is_symlink() and Path(real).is_relative_to(os.path.realpath(root))):
        return False
    seen.add(real)
    return True


def _finished(files: Storage) -> Listed:
    path = files.name if files.url else Path(files.name)
    try:
        stored = Stored.open(files)
        listed = stored.manifest
        total = sum(file.bytes for file in listed.files)
        return _of(path, declared_spec(stored), "finished", listed.rows, listed.content_root, total)
    except IbdataError:
        return Listed(path, "unreadable", None, None, [], [], _size(files), None)


def _unfinished(run: Run) -> Listed:
    path = Path(run.name) if isinstance(run, FolderRun) else run.name
    with suppress(DatasetError):
        if record := Record.read(run):
            state = f"unfinished, {len(run.receipts())} of {counted(record.shards, 'shard')}"
            return _of(path, record.dataset_spec(), state, None, None, _size(run.files))
    return Listed(path, "unfinished, unreadable", None, None, [], [], _size(run.files), None)


def _of(
    path: Path | str, spec: DatasetSpec, state: str, rows: int | None, root: str | None, total: int
) -> Listed:
    return Listed(path, state, spec.name, rows, spec.setpoints, spec.labels, total, root)


def _size(files: Storage) -> int:
    """The bytes of all files in a folder and below it."""
    if isinstance(files, Remote):
        return sum(files.sizes().values())
    places = (os.path.join(place, name) for place, _, names in os.walk(files.path) for name in names)
    return sum(os.lstat(place).st_size for place in places if os.path.lexists(place))
