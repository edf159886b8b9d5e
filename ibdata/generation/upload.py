"""Writing datasets to URLs: they are made in a folder on this machine, then uploaded, the manifest last.

An upload first lists at the URL what it will put there, in `PENDING`. After an interruption, only files of an
upload of the same experiment are written over or removed.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import NamedTuple

from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.dataset.reader import Dataset
from ibdata.errors import BusyError, DatasetError, IbdataError, UsageError
from ibdata.experiment import Experiment, as_yaml
from ibdata.generation import output_folder
from ibdata.system import lock
from ibdata.system.atomic_files import plain_bytes
from ibdata.system.cache_folders import cache_base
from ibdata.system.object_store import Remote, first_line, readable
from ibdata.system.signals import check, stoppable

PENDING = "meta/pending.json"  # the manifest of what is being uploaded: the first file there, removed last


class Found(NamedTuple):
    """The files at a URL with their bytes, and the manifest that lists them; None where there are none."""

    sizes: dict[str, int]
    listed: Manifest | None
    finished: bool


def find(remote: Remote, experiment: Experiment, work: Path, resume: bool, overwrite: bool = False) -> Found:
    """Find what is at the URL: nothing, or with `resume` the experiment's dataset or an upload of it.

    Raises UsageError where something else is there; nothing is changed.
    """
    if overwrite:
        raise UsageError(
            f"{remote.name}: --overwrite is for folders; remove what is there, or choose another --out"
        )
    if remote.folder is not None:
        manifest.refuse_inside(remote.folder)
        output_folder.refuse_links(remote.folder)
    with readable(remote, manifest.PATH):
        found = _found(remote, work)
    if found.listed is None:
        return found
    if not resume:
        raise UsageError(
            f"{remote.name}: exists already; choose another --out"
            if found.finished
            else f"{remote.name}: holds an upload that was interrupted; --resume to go on with it, "
            "or choose another --out"
        )
    recorded = found.listed.entries().get(manifest.EXPERIMENT)
    same = recorded is not None and recorded.sha256 == hashlib.sha256(as_yaml(experiment)).hexdigest()
    if not same:
        what = "dataset" if found.finished else "interrupted upload"
        raise UsageError(f"{remote.name}: holds the {what} of another experiment; choose another --out")
    if found.finished:
        _refuse_incomplete(remote, found)
    return found


def _refuse_incomplete(remote: Remote, found: Found) -> None:
    """Raise DatasetError if a file of a finished dataset is missing or has another size."""
    assert found.listed is not None
    for file in found.listed.files:
        size = found.sizes.get(file.path)
        if size != file.bytes:
            seen = "is missing" if size is None else f"has {size} bytes, expected {file.bytes}"
            raise DatasetError(
                f"{remote.name}: {file.path} {seen}; remove what is there, or choose another --out"
            )


def _found(remote: Remote, work: Path) -> Found:
    """Look at the URL; UsageError where a file there is no part of a dataset or of an upload."""
    sizes = remote.sizes()
    begun, ended = (remote.read(path) if path in sizes else None for path in (PENDING, manifest.PATH))
    if ended is not None and begun in (None, ended):
        return Found(sizes, _parsed(remote, manifest.PATH, ended), True)
    listed, known = None, {PENDING}
    if begun is not None and begun != (own := _manifest(work)) and own.startswith(begun):
        listed = manifest.read(work)  # this upload was interrupted in its first file
    elif begun is not None:
        listed = _parsed(remote, PENDING, begun)
        known |= {
            manifest.SPLITS,
            *listed.entries(),
            *([manifest.PATH] if begun.startswith(ended or b"") else []),
        }
    for path in sorted(sizes.keys() - known):
        raise UsageError(
            f"{remote.name}: holds files, but no finished dataset; {path} is no part of an upload: "
            "move it away, or choose another --out"
        )
    return Found(sizes, listed, False)


def _manifest(work: Path) -> bytes:
    """The manifest of the dataset that was made in a folder; empty where there is none yet."""
    path = work / manifest.PATH
    return plain_bytes(path, manifest.MAX_BYTES) if path.is_file() else b""


def _parsed(remote: Remote, path: str, data: bytes) -> Manifest:
    try:
        return manifest.parsed(Path(path), data)
    except DatasetError as error:
        raise UsageError(f"{remote.name}/{error}; move it away, or choose another --out") from None


def work_folder(remote: Remote, experiment: Experiment) -> Path:
    """The folder in which a dataset is made before it is uploaded; the same for a run that is resumed."""
    name = hashlib.sha256(f"{remote.url} {output_folder.identity(experiment)}".encode()).hexdigest()[:24]
    return Path(cache_base(), "uploads", name)


def upload(remote: Remote, experiment: Experiment, work: Path, resume: bool) -> Dataset:
    """Upload the finished dataset in a folder, and remove the folder. Raises IbdataError if that fails.

    Complete files from an earlier upload of the same files are kept, and those of another run are removed.
    The URL holds no dataset until the manifest, the last file, is there.
    """
    alone = lock.locked(work) if work.is_dir() else nullcontext()  # else only `PENDING` is left to remove
    with _refusals(remote), stoppable(), alone:
        found = find(remote, experiment, work, resume)  # again: to make the dataset took a while
        if not found.finished:
            _put_all(remote, found, work)
        if PENDING in found.sizes or not found.finished:
            remote.remove(PENDING)
    shutil.rmtree(work, ignore_errors=True)
    return Dataset(remote.url)


def _put_all(remote: Remote, found: Found, work: Path) -> None:
    own = work / manifest.PATH
    content = own.read_bytes()
    left = found.sizes if remote.read(PENDING) == content else {}
    if not left:
        for path in sorted(found.sizes.keys() - {PENDING}):
            remote.remove(path)
            check()
        remote.put(own, PENDING)
    for file in manifest.read(work).files:
        if left.get(file.path) != file.bytes:
            _refuse_taken_over(remote, content)
            remote.put(work / file.path, file.path)
        check()
    _refuse_taken_over(remote, content)
    remote.put(work / manifest.SPLITS, manifest.SPLITS)
    remote.put(own, manifest.PATH)


def _refuse_taken_over(remote: Remote, own: bytes) -> None:
    """Raise BusyError if an upload on another machine has begun at the URL since this one began."""
    if remote.read(PENDING) != own:
        raise BusyError(f"{remote.name}: another machine is uploading there; this upload has stopped")


@contextmanager
def _refusals(remote: Remote) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise IbdataError(
            f"{remote.name}: cannot be written: {first_line(error)}; --resume uploads what is missing"
        ) from None
