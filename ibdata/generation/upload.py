"""Writing datasets to URLs: they are made in a folder on this machine, then uploaded, the manifest last.

An object store cannot rename. So the place must hold no other files, and an upload that failed is repeated in
full.
"""

from __future__ import annotations

import hashlib
import shutil
from contextlib import suppress
from pathlib import Path

from ibdata._system.cache_folders import cache_folders
from ibdata._system.files import is_litter
from ibdata._system.part import locked_part
from ibdata._system.signals import check
from ibdata._system.storage import Remote, Storage, reason
from ibdata.dataset import manifest
from ibdata.errors import OUT, OVERWRITE, DatasetError, IbdataError, Interrupted, UsageError, hidden
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.generation.build import other_dataset, refuse_damage, refuse_name


def work_folder(url: str) -> Path:
    """The folder in which a dataset is made before it is uploaded to a URL, the same in each try."""
    identity = hashlib.sha256(Remote(url).url.encode()).hexdigest()[:24]
    return Path(cache_folders().folders[-1], "uploads", identity, "dataset")


def is_there(remote: Remote, spec: DatasetSpec, work: Path, overwrite: bool) -> bool:
    """Whether a dataset is at a URL. Files of an upload that failed are nothing.

    Raises UsageError if there is something else, or no dataset can appear there, and DatasetError if it is
    damaged.
    """
    refuse_overwrite(remote.name, overwrite)
    refuse_name(remote.parts, remote.name)
    if remote.folder is not None:
        manifest.refuse_inside(remote.folder)
    try:
        sizes = remote.sizes()
    except OSError as error:
        raise DatasetError(f"{remote.name}: cannot be read: {reason(error)}") from None
    try:
        listed = manifest.read(remote)
    except DatasetError as error:
        if sizes.keys() <= _files(work):
            return False
        if not isinstance(error, manifest.NoDatasetError):
            raise
        raise UsageError(
            f"{remote.name}: holds files, but no finished dataset, such as {min(sizes)}; remove them, or "
            f"choose another {OUT}"
        ) from None
    if other := other_dataset(listed, spec):
        raise UsageError(f"{remote.name}: holds {other}; remove it, or choose another {OUT}")
    refuse_damage(listed, sizes.get, remote.name)
    with suppress(DatasetError):
        if manifest.read(work).checksum == listed.checksum:  # an upload was killed at its end
            shutil.rmtree(work)
    return True


def refuse_overwrite(url: str, overwrite: bool) -> None:
    """Raise UsageError where a dataset at a URL is to be replaced."""
    if overwrite:
        raise UsageError(
            f"{hidden(url)}: {OVERWRITE} is for folders; remove what is there, or choose another {OUT}"
        )


def _files(work: Path) -> set[str]:
    return {path.relative_to(work).as_posix() for path in work.rglob("*") if not is_litter(path.name)}


def drop_damaged(work: Path, name: str) -> None:
    """Remove what waits for its upload unless it is whole."""
    if not work.exists():
        return
    with locked_part(work, name):  # nobody uploads it
        files, is_whole = Storage(work), False
        with suppress(DatasetError):
            entries = manifest.read(work).entries().items()
            is_whole = (work / manifest.SPLITS).is_file() and all(files.entry(p) == e for p, e in entries)
        if not is_whole:
            shutil.rmtree(work, ignore_errors=True)


def upload(remote: Remote, work: Path) -> None:
    """Upload the finished dataset in a folder, the manifest last, and remove the folder."""
    with locked_part(work, remote.name):  # nobody else uploads it, or removes it
        try:
            if others := remote.sizes().keys() - _files(work):  # of a try whose dataset was damaged here
                raise UsageError(f"{remote.name}: holds other files, such as {min(others)}; remove them")
            for path in [*sorted(_files(work) - {manifest.PATH}), manifest.PATH]:
                if (work / path).is_file():
                    remote.put(work / path, path)
                check()
        except Interrupted as error:
            error.left = "the dataset is not uploaded; the same command uploads it"
            raise
        except OSError as error:
            raise IbdataError(
                f"{remote.name}: cannot be written: {reason(error)}; the same command tries again"
            ) from None
        shutil.rmtree(work, ignore_errors=True)
    with suppress(OSError):
        work.parent.rmdir()
