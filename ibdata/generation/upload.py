"""Writing datasets to URLs: they are made in a folder on this machine, then uploaded, the manifest last."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.reader import Dataset
from ibdata.errors import IbdataError, UsageError
from ibdata.experiment import Experiment, as_yaml
from ibdata.generation import output_folder
from ibdata.system.cache_folders import cache_base
from ibdata.system.object_store import Remote, first_line, readable
from ibdata.system.signals import check, stoppable

PENDING = "meta/pending.json"  # the manifest of an upload that has not finished


def refuse(remote: Remote, experiment: Experiment, resume: bool, overwrite: bool) -> bool:
    """Whether the experiment's dataset is at the URL already. Raises UsageError if something else is."""
    if overwrite:
        raise UsageError(
            f"{remote.name}: --overwrite is for folders; remove what is there, or choose another --out"
        )
    with readable(remote, manifest.PATH):
        if remote.size(manifest.PATH) is None or remote.size(PENDING) is not None:
            if not resume and not remote.empty():
                raise UsageError(
                    f"{remote.name}: holds files, but no finished dataset; --resume to go on with an upload, "
                    "or choose another --out"
                )
            return False
        if not resume:
            raise UsageError(f"{remote.name}: exists already; choose another --out")
        if remote.read(manifest.EXPERIMENT) != as_yaml(experiment):
            raise UsageError(f"{remote.name}: holds the dataset of another experiment; choose another --out")
    return True


def work_folder(remote: Remote, experiment: Experiment) -> Path:
    """The folder in which a dataset is made before it is uploaded; the same for a run that is resumed."""
    name = hashlib.sha256(f"{remote.url} {output_folder.identity(experiment)}".encode()).hexdigest()[:24]
    return Path(cache_base(), "uploads", name)


def upload(remote: Remote, work: Path) -> Dataset:
    """Upload the finished dataset in a folder, and remove the folder. Raises IbdataError if that fails.

    Complete files from an earlier upload of the same dataset are kept. The URL holds no dataset until the
    manifest, the last file, is there.
    """
    listed = work / manifest.PATH
    with _refusals(remote), stoppable():
        same = remote.read(PENDING) == listed.read_bytes()
        if not same:
            remote.put(listed, PENDING)
        for file in manifest.read(work).files:
            if not (same and remote.size(file.path) == file.bytes):
                remote.put(work / file.path, file.path)
            check()
        remote.put(listed, manifest.PATH)
        remote.remove(PENDING)
    shutil.rmtree(work)
    return Dataset(remote.url)


@contextmanager
def _refusals(remote: Remote) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise IbdataError(
            f"{remote.name}: cannot be written: {first_line(error)}; --resume uploads what is missing"
        ) from None
