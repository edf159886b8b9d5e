"""meta/manifest.json, written last: what is listed there exists, and nothing else does.

A dataset is replaced in three moves, each of which leaves the old one or the new one whole: the new files
are written under `.next`; renaming that to `.new` makes them count; then they move to their places, the
manifest last. Whoever reads looks into `.new` first, whoever writes settles what a killed writer left there.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ibdata.dataset.files import sync_folder
from ibdata.errors import DatasetError

PATH = "meta/manifest.json"
METADATA = ("meta/info.json", "meta/episodes.parquet", "meta/stats.json", "meta/experiment.yaml")
CARD = "README.md"
NEXT = ".next"
NEW = ".new"
FORMAT = "ibdata-manifest"
VERSION = 1
DATA_VERSION = 1  # raised whenever the same experiment gives other bytes
SAFE_PATH = re.compile(r"(README\.md|(data|meta)/[a-z0-9][a-z0-9._-]{0,100})")


def read(folder: Path) -> dict[str, Any]:
    """The manifest of a finished dataset; DatasetError where there is none, or not a whole one."""
    path = locate(folder, PATH)
    try:
        data = json.loads(content(folder, PATH))
    except (FileNotFoundError, NotADirectoryError):
        raise DatasetError(f"{folder}: no finished dataset here: {PATH} is missing") from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: found no valid JSON ({error}), expected a manifest") from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise DatasetError(f"{path}: found another format, expected {FORMAT}")
    if data.get("version") != VERSION:
        raise DatasetError(
            f"{path}: found version {data.get('version')}, expected {VERSION}; use a newer ibdata"
        )
    if data.get("checksum") != checksum(data):
        raise DatasetError(f"{path}: found content that does not fit its checksum; the file has been changed")
    paths = [entry["path"] for key in ("files", "shards") for entry in data[key]]
    unsafe = [path for path in paths if not SAFE_PATH.fullmatch(path)]
    if unsafe:
        raise DatasetError(f"{path}: found the path {unsafe[0]!r}, expected paths in data/ and meta/")
    return data


def locate(folder: Path, path: str) -> Path:
    """Where a file of the dataset is: in `.new` while a replacement settles, else in its place."""
    new = folder / NEW / path
    return new if os.path.lexists(new) else folder / path


def content(folder: Path, path: str) -> bytes:
    """What is in a file of the dataset; also while a replacement moves it to its place."""
    try:
        return locate(folder, path).read_bytes()
    except FileNotFoundError:
        return locate(folder, path).read_bytes()


def outgoing(folder: Path) -> set[str]:
    """Files that are there because a replacement that counts has not been settled; it will remove them."""
    return _listed(folder / PATH) if (folder / NEW / PATH).is_file() else set()


def checksum(data: Mapping[str, Any]) -> str:
    """SHA-256 of the manifest without its checksum, as JSON with sorted keys."""
    rest = {key: value for key, value in data.items() if key != "checksum"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def promote(folder: Path) -> None:
    """Make the whole dataset, or the changed files and the manifest, in `.next` the ones that count."""
    (folder / NEXT).rename(folder / NEW)
    sync_folder(folder)
    settle(folder)


def settle(folder: Path) -> None:
    """Move what counts from `.new` to its place, and remove what only the old manifest lists."""
    new = folder / NEW
    if (new / PATH).is_file():
        listed = {file["path"] for file in read(folder)["files"]}
        old = _listed(folder / PATH)
        for path in sorted(listed):
            if os.path.lexists(new / path):
                _move(new / path, folder / path)
        for path in old - listed:
            (folder / path).unlink(missing_ok=True)
        _move(new / PATH, folder / PATH)
    for part in (new / "data", new / "meta", new):
        if part.is_dir() and not part.is_symlink():
            part.rmdir()


def _move(source: Path, target: Path) -> None:
    target.parent.mkdir(exist_ok=True)
    source.replace(target)
    sync_folder(target.parent)


def _listed(path: Path) -> set[str]:
    """The safe paths that the manifest being replaced lists; none if it cannot be read."""
    try:
        files = json.loads(path.read_bytes())["files"]
        return {file["path"] for file in files if SAFE_PATH.fullmatch(file["path"])}
    except (OSError, ValueError, KeyError, TypeError):
        return set()
