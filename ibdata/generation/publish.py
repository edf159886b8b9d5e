"""Publishing a dataset: the folder that was made in a part gets its name by one rename.

Where a dataset is replaced, the two folders change places in one system call, and the old one is removed with
the part. Every reader finds the old dataset or the new one.
"""

from __future__ import annotations

from pathlib import Path

from ibdata.dataset import manifest
from ibdata.errors import DatasetError
from ibdata.generation import origin
from ibdata.generation.receipt import DATASET
from ibdata.system.files import keep_access, sync_folder, write
from ibdata.system.part import Part
from ibdata.system.signals import held, ignore
from ibdata.writing.edited import keep_all
from ibdata.writing.metadata import as_json


def publish(part: Part) -> None:
    """Give the finished dataset in a part its name, in place of what is there, and remove the part.

    The note of the run first gets the checksum of the new manifest. So whoever holds the part next can tell
    whether this was done, and `settle` does it where it was not.
    """
    made = part.folder / DATASET
    if part.target.is_dir():
        _keep(part.target, made)
    for folder in (made / "data", made / "meta", made):
        sync_folder(folder)
    began = origin.read(part.folder)
    if began is not None:  # a merge or a copy has no note
        ended = began.model_copy(update={"manifest": _checksum(made)})
        write(part.folder, origin.PATH, as_json(ended))
    ignore()  # a run that has published is finished, and not stopped
    part.place(made)
    part.clear()


def settle(part: Part) -> None:
    """Finish what a killed run was publishing, and remove what it has published."""
    began = origin.read(part.folder)
    if began is None or began.manifest is None:
        return
    if _checksum(part.target) == began.manifest:
        part.clear()
    elif not part.target.exists() and _checksum(part.folder / DATASET) == began.manifest:
        with held():
            part.place(part.folder / DATASET)
        part.clear()


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
