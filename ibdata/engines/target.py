"""The output folder: what may be written where, and what is taken away again."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.files import TEMPORARY
from ibdata.errors import DatasetError, UsageError


def check(folder: Path, overwrite: bool) -> None:
    """UsageError unless the folder is new, empty, or a dataset that may be overwritten."""
    if not os.path.lexists(folder):
        return
    if not folder.is_dir():
        raise UsageError(f"{folder}: found a file, expected a folder or nothing; choose another --out")
    if not any(folder.iterdir()):
        return
    if not overwrite:
        raise UsageError(
            f"{folder}: exists already; choose another --out, or --overwrite to replace a dataset"
        )
    try:
        manifest.read(folder)
    except DatasetError as error:
        raise UsageError(f"{folder}: not a dataset of ibdata, not overwritten ({error})") from None


def clear(folder: Path) -> None:
    """Remove the finished dataset in the folder, if there is one: the files that its manifest lists."""
    if not (folder / manifest.PATH).exists():
        return
    listed = [file["path"] for file in manifest.read(folder)["files"]]
    remove(folder, [manifest.PATH, *listed])


def remove(folder: Path, files: Iterable[str]) -> None:
    """Remove these files, ibdata's temporary ones beside them, and the folders that become empty."""
    for file in files:
        (folder / file).unlink(missing_ok=True)
    for part in (folder / "data", folder / "meta", folder):
        if part.is_dir() and not part.is_symlink():
            for temporary in part.glob(f"{TEMPORARY}*"):
                temporary.unlink(missing_ok=True)
            if part != folder and not any(part.iterdir()):
                part.rmdir()
