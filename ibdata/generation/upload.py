"""Writing datasets to URLs: they are made in a folder on this machine, then uploaded, the manifest last.

An object store cannot rename. So the place must hold no other files, and an upload that failed is repeated in
full.
"""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.errors import DatasetError, IbdataError, Interrupted, UsageError, hidden
from ibdata.experiment import Experiment, as_yaml
from ibdata.generation.target import refuse_incomplete, refuse_name
from ibdata.system.cache_folders import cache_folders
from ibdata.system.signals import check, stoppable
from ibdata.system.storage import Remote, Storage, reason


def places(url: str, experiment: Experiment) -> tuple[Path, Remote]:
    """The folder in which a dataset is made before it is uploaded, the same in each try, and the URL."""
    remote = Remote(url)
    identity = hashlib.sha256(remote.url.encode() + as_yaml(experiment)).hexdigest()[:24]
    return Path(cache_folders().folders[-1], "uploads", identity, "dataset"), remote


def is_there(remote: Remote, experiment: Experiment, work: Path, resume: bool, overwrite: bool) -> bool:
    """Whether the dataset of an experiment is at the URL.

    Raises UsageError if other files are there; those of an upload that failed are allowed with `resume`.
    """
    refuse_overwrite(remote.name, overwrite)
    refuse_name(remote.parts, remote.name)
    if remote.folder is not None:
        manifest.refuse_inside(remote.folder)
    try:
        found = remote.sizes()
    except OSError as error:
        raise DatasetError(f"{remote.name}: cannot be read: {reason(error)}") from None
    listed = _manifest(remote, resume) if manifest.PATH in found else None
    if listed is not None:
        recorded = listed.entries().get(manifest.EXPERIMENT)
        if recorded is None or recorded.sha256 != hashlib.sha256(as_yaml(experiment)).hexdigest():
            raise UsageError(f"{remote.name}: holds the dataset of another experiment; choose another --out")
        refuse_incomplete(listed, found.get, remote.name)
        return True
    if found and not (resume and found.keys() <= _files(work)):
        raise UsageError(
            f"{remote.name}: holds files, but no finished dataset, such as {min(found)}; --resume repeats an "
            "upload that failed on this machine; otherwise remove them, or choose another --out"
        )
    return False


def refuse_overwrite(url: str, overwrite: bool) -> None:
    """Raise UsageError where a dataset at a URL is to be replaced."""
    if overwrite:
        raise UsageError(
            f"{hidden(url)}: --overwrite is for folders; remove what is there, or choose another --out"
        )


def _manifest(remote: Remote, resume: bool) -> Manifest | None:
    """The manifest at the URL. With `resume`, one that is damaged counts as part of an upload that failed."""
    try:
        return manifest.read(remote)
    except DatasetError:
        if not resume:
            raise
        return None


def _files(work: Path) -> set[str]:
    return {str(path.relative_to(work)) for path in work.rglob("*")}


def drop_damaged(work: Path) -> None:
    """Remove a dataset that waits for its upload if it is no longer whole, so that it is made again."""
    try:
        entries, files = manifest.read(work).entries(), Storage(work)
    except DatasetError:
        return
    is_whole = (work / manifest.SPLITS).is_file()
    if not is_whole or any(files.entry(path) != entry for path, entry in entries.items()):
        shutil.rmtree(work)


def upload(remote: Remote, work: Path) -> None:
    """Upload the finished dataset in a folder, the manifest last, and remove the folder."""
    try:
        with stoppable():
            for path in [*sorted(_files(work) - {manifest.PATH}), manifest.PATH]:
                if (work / path).is_file():
                    remote.put(work / path, path)
                check()
    except Interrupted as error:
        error.left = "the dataset is not uploaded; --resume uploads it"
        raise
    except OSError as error:
        raise IbdataError(
            f"{remote.name}: cannot be written: {reason(error)}; --resume tries again"
        ) from None
    shutil.rmtree(work.parent, ignore_errors=True)
