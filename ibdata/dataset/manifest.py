"""meta/manifest.json, written last: what is listed there exists, and nothing else does.

A dataset is replaced in three moves, each of which leaves the old one or the new one whole: the new files
are written under `.next`; renaming that to `.new` makes them count; then they move to their places, the
manifest last. Whoever reads looks into `.new` first, whoever writes settles what a killed writer left there.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ibdata.dataset import shape, storage
from ibdata.dataset.files import plain_bytes, sync_folder
from ibdata.errors import DatasetError, printable

PATH = "meta/manifest.json"
EXPERIMENT = "meta/experiment.yaml"
METADATA = ("meta/info.json", "meta/episodes.parquet", "meta/stats.json", EXPERIMENT)
CARD = "README.md"
REPORT = "report.html"  # where there is one: `ibdata card` makes it
NEXT = ".next"
NEW = ".new"
FORMAT = "ibdata-manifest"
VERSION = 1
DATA_VERSION = 1  # raised whenever the same experiment gives other bytes
SAFE_PATH = re.compile(shape.SAFE_PATH)
MAX_BYTES = 2**32  # of a JSON file, which is read whole


class NewerError(DatasetError):
    """A newer ibdata made the dataset."""


def read(folder: Path) -> dict[str, Any]:
    """The manifest of a finished dataset; DatasetError where there is none, or not a whole one."""
    try:
        data = _loaded(folder, PATH, "a manifest")
    except (FileNotFoundError, NotADirectoryError):
        raise DatasetError(
            f"{storage.name_of(folder)}: no finished dataset here: {PATH} is missing"
        ) from None
    path = locate(folder, PATH)
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise DatasetError(f"{path}: found another format, expected {FORMAT}")
    if data.get("version") != VERSION:
        found = printable(repr(data.get("version")))[:60]
        raise NewerError(f"{path}: found version {found}, expected {VERSION}; use a newer ibdata")
    if data.get("checksum") != checksum(data):
        raise DatasetError(f"{path}: found content that does not fit its checksum; the file has been changed")
    return _of_shape(path, shape.Manifest, data)


def read_json(folder: Path, path: str, form: type[shape.Shape]) -> dict[str, Any]:
    """A JSON file of a dataset; DatasetError where it is missing, unreadable, or of another shape."""
    try:
        data = _loaded(folder, path, "JSON")
    except (FileNotFoundError, NotADirectoryError):
        raise DatasetError(f"{folder / path}: missing; ibdata repair {folder}") from None
    return _of_shape(folder / path, form, data)


def _loaded(folder: Path, path: str, what: str) -> Any:
    place = locate(folder, path)
    try:
        data = json.loads(content(folder, path), parse_constant=_no_constant, parse_float=_finite)
        return _encodable(data)
    except (FileNotFoundError, NotADirectoryError):
        raise
    except OSError as error:
        raise DatasetError(f"{place}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{place}: found no valid JSON ({error}), expected {what}") from None


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")


def _encodable(data: Any) -> Any:
    """JSON data whose texts have no half of a character; no other text can be written again."""
    try:
        json.dumps(data, ensure_ascii=False).encode()
    except UnicodeEncodeError as error:
        raise ValueError(f"{error.object[error.start]!r} is half a character") from None
    return data


def _finite(digits: str) -> float:
    number = float(digits)
    if math.isinf(number):
        raise ValueError(f"{digits[:40]} is too large a number")
    return number


def _of_shape(path: Path, form: type[shape.Shape], data: Any) -> dict[str, Any]:
    wrong = shape.misfit(form, data)
    if wrong is not None:
        raise DatasetError(f"{path}: {wrong}")
    whole: dict[str, Any] = data
    return whole


def locate(folder: Path, path: str) -> Path:
    """Where a file of the dataset is: in `.new` while a replacement settles, else in its place."""
    storage.ensure(folder, path)
    new = folder / NEW / path
    return new if os.path.lexists(new) else folder / path


def content(folder: Path, path: str) -> bytes:
    """What is in a file of the dataset; also while a replacement moves it to its place."""
    try:
        return plain_bytes(locate(folder, path), MAX_BYTES)
    except FileNotFoundError:
        return plain_bytes(locate(folder, path), MAX_BYTES)


def outgoing(folder: Path) -> set[str]:
    """Files that are there because a replacement that counts has not been settled; it will remove them."""
    return _listed(folder / PATH) if (folder / NEW / PATH).is_file() else set()


def checksum(data: Mapping[str, Any]) -> str:
    """SHA-256 of the manifest without its checksum, as JSON with sorted keys."""
    rest = {key: value for key, value in data.items() if key != "checksum"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def promote(folder: Path) -> None:
    """Make the whole dataset, or the changed files and the manifest, in `.next` the ones that count."""
    for path in (folder / NEXT).rglob("*"):
        place = folder / path.relative_to(folder / NEXT)
        if path.is_file() and place.is_dir():
            raise DatasetError(f"{place}: found a folder, expected a file; move it away")
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
        files = json.loads(plain_bytes(path, MAX_BYTES))["files"]
        return {file["path"] for file in files if SAFE_PATH.fullmatch(file["path"])}
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return set()
