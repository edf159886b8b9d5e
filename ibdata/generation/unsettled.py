"""The files of a replacement that a killed writer left in `.new`: which are there, and which are whole."""

from __future__ import annotations

import os
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.manifest import FRESH, NEW
from ibdata.dataset.models import File, Manifest
from ibdata.errors import DatasetError
from ibdata.system.atomic_files import file_sha256, plain_bytes
from ibdata.system.signals import check

PARTS = ("data", "meta")


def listed_in(folder: Path, path: str = manifest.PATH) -> Manifest:
    """Read the manifest in a folder. Raises OSError or DatasetError."""
    return manifest.parsed(folder / path, plain_bytes(folder / path, manifest.MAX_BYTES))


def files_in(folder: Path, path: str = manifest.PATH) -> list[File]:
    """The files that the manifest in a folder lists; none without a valid manifest."""
    try:
        return listed_in(folder, path).files
    except (OSError, DatasetError):
        return []


def paths_in(folder: Path) -> list[str]:
    """The paths of these files."""
    return [file.path for file in files_in(folder)]


def is_complete(folder: Path) -> bool:
    """Whether `.new` is a complete replacement: all files that its manifest lists are there."""
    new = folder / NEW
    if not (new / "meta" / FRESH).is_file():
        return (folder / "meta" / FRESH).is_file()  # `meta` may be in its place already
    paths = paths_in(new)
    return bool(paths) and all((new / path).is_file() or (folder / path).is_file() for path in paths)


def old_data(folder: Path) -> Path | None:
    """The folder in `.new` that holds the old data; None if they are in their place, or if there are none."""
    data = folder / "data"
    if data.is_dir() and not (data / FRESH).is_file():
        return None
    found = (folder / NEW / name for name in ("old-data", "data"))
    return next((path for path in found if path.is_dir() and not (path / FRESH).is_file()), None)


def damaged(folder: Path) -> Path | None:
    """The first file of the replacement that is not as its manifest lists it; None if all are.

    None also if the old dataset has no manifest or if `meta` has been replaced: then the old dataset is gone.
    A file does not count that the old dataset lists too, if it is damaged there as well.
    """
    new = folder / NEW
    if not ((new / "meta" / FRESH).is_file() and os.path.lexists(folder / manifest.PATH)):
        return None
    try:
        files = listed_in(new).files
    except (OSError, DatasetError):
        return new / manifest.PATH
    for file in files:
        place = _place(folder, file.path)
        if place is not None and file_sha256(place) != file.sha256 and not _is_lost_too(folder, file):
            return place
        check()
    return None


def _place(folder: Path, path: str) -> Path | None:
    """The place of a file that the replacement brings; None if it leaves the old one where it is."""
    new, (part, inside, _) = folder / NEW, path.partition("/")
    if not inside:
        return new / path if (new / path).is_file() else None
    return next((place / path for place in (new, folder) if (place / part / FRESH).is_file()), None)


def _is_lost_too(folder: Path, file: File) -> bool:
    return file in files_in(folder) and file_sha256(folder / file.path) != file.sha256


def lost(folder: Path) -> Path | None:
    """The first file in `data` and `meta` of the old dataset that is nowhere whole; None if all are."""
    try:
        files = listed_in(folder).files
    except (OSError, DatasetError):
        return folder / manifest.PATH
    new = folder / NEW
    for file in files:
        places = (folder / file.path, new / file.path, new / f"old-{file.path}")
        if "/" in file.path and all(file_sha256(place) != file.sha256 for place in places):
            return folder / file.path
        check()
    return None
