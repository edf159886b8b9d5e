"""Publishing a finished dataset out of the part in which it was made, by one rename.

Where a dataset is replaced, the two folders change places in one system call, and the old one is removed with
the part. Every reader finds the old dataset or the new one.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.errors import DatasetError, IbdataError
from ibdata.generation.record import Record
from ibdata.generation.target import Target
from ibdata.system.files import keep_access, sync_all
from ibdata.system.part import Part, locked_part
from ibdata.system.signals import held, ignore
from ibdata.writing.edited import keep_all
from ibdata.writing.shard import DATASET


def publish(part: Part) -> None:
    """Give the finished dataset in a part its name, in place of what is there, and remove the part.

    The note of the run first gets the checksum of the new manifest. So whoever holds the part next can tell
    whether this was done, and `recover` does it where it was not.
    """
    folder = part.folder / DATASET
    if part.target.is_dir():
        _keep(part.target, folder)
    sync_all(folder)
    record = Record.read(part.folder)
    if record is not None:  # a merge or a copy has no note
        record.model_copy(update={"manifest": _checksum(folder)}).write(part.folder)
    ignore()  # a run that has published is finished, and not stopped
    part.place(folder)
    part.clear()


def recover(part: Part) -> None:
    """Finish what a killed run was publishing from a part, and remove what it has published."""
    record = Record.read(part.folder)
    if record is None or record.manifest is None:
        return
    if _checksum(part.target) == record.manifest:
        part.clear()
    elif not part.target.exists() and _checksum(part.folder / DATASET) == record.manifest:
        with held():
            part.place(part.folder / DATASET)
        part.clear()


def remove_published(target: Target) -> None:
    """Remove the part of a dataset that is there, if its run was killed after it had published it."""
    if target.part.folder.exists():
        with suppress(IbdataError), locked_part(target.path) as part:
            recover(part)


def _checksum(folder: Path) -> str | None:
    try:
        return manifest.read(folder).checksum
    except DatasetError:
        return None


def _keep(old: Path, new: Path) -> None:
    """Keep the mode and the group of a folder that is replaced, and what somebody has edited in it."""
    for path in [new, *new.rglob("*")]:
        keep_access(old / path.relative_to(new) if path.is_dir() else old / manifest.PATH, path)
    keep_all(old, new)
