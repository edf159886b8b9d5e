"""What is in folders, finished or not, and true hashes for a changed dataset."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from ibdata._system.part import Part
from ibdata.dataset import manifest
from ibdata.generation.metadata import as_json

Json = dict[str, Any]


def contents(folder="."):
    """Every file and folder below a folder, with the bytes of the files."""
    paths = sorted(Path(folder).rglob("*"))
    return {str(path): path.read_bytes() if path.is_file() else None for path in paths}


def part_of(place):
    """The hidden folder in which the dataset of a place is made."""
    return Path(place).with_name(f".{Path(place).name}.part")


def litter(folder):
    """Leave in a folder and below it what macOS does: .DS_Store, and ._NAME beside every file and folder."""
    for path in [folder, *Path(folder).rglob("*")]:
        path.with_name(f"._{path.name}").write_bytes(b"\0\5\x16\7 Mac OS X")
        if path.is_dir():
            (path / ".DS_Store").write_bytes(b"\0\0\0\1Bud1")


def run_of(place):
    """The folder of the unfinished run."""
    return Part(Path(place)).run


def receipts(place):
    """The names of the receipts of the unfinished run."""
    return sorted(path.name for path in Part(Path(place)).receipts)


def is_right(made, plain, files):
    """Whether a folder holds the files of another with the same dataset, and no part is left beside it."""
    return files(made) == files(plain) and not part_of(made).exists()


def seal(folder: Path, change: Callable[[Json], object] = lambda manifest: None) -> None:
    """Give Croissant and the manifest the true hashes of all files, change it, then give it its checksum."""
    sealed = json.loads((folder / manifest.PATH).read_bytes())
    with suppress(ValueError, TypeError):  # a test has made something else of it
        seal_description(folder / manifest.CROISSANT)
    for file in sealed["files"]:
        data = (folder / file["path"]).read_bytes()
        file |= {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
    change(sealed)
    sealed["checksum"] = manifest.checksum(sealed)
    (folder / manifest.PATH).write_bytes(as_json(sealed))


def seal_description(path: Path) -> None:
    """Give a description in Croissant the hashes of all files as they are."""
    description = json.loads(path.read_bytes())
    for file in description["distribution"]:
        if (described := path.parent.parent / file["@id"]).is_file():
            data = described.read_bytes()
            file |= {"contentSize": f"{len(data)} B", "sha256": hashlib.sha256(data).hexdigest()}
    path.write_bytes(as_json(description))
