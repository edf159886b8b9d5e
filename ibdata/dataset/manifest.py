"""Reading meta/manifest.json, which is written last and lists every file of a finished dataset.

While a dataset is being replaced (see `ibdata.generation.replacement`), a file that is not in its place may
be in `.new`.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import stat
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from ibdata.dataset.models import SAFE_PATH as SAFE_PATH_PATTERN
from ibdata.dataset.models import Manifest, Parsed, parse
from ibdata.errors import DatasetError, UsageError, nearest, printable
from ibdata.system import object_store
from ibdata.system.atomic_files import plain_bytes
from ibdata.system.object_store import damaged

PATH = "meta/manifest.json"
EXPERIMENT = "meta/experiment.yaml"
METADATA = ("meta/info.json", "meta/episodes.parquet", "meta/stats.json", EXPERIMENT)
CARD = "README.md"
REPORT = "report.html"  # only after `ibdata card`
NEXT = ".next"  # the folder in which a replacement is written
NEW = ".new"  # its name while it takes the place of the old dataset
MARK = ".ibdata-replacement"  # an empty file in both, which shows that ibdata made them
BAR = b"This dataset is being replaced, or was; read it again.\n"  # a file on which Parquet readers fail
REPLACED = "replaced"  # the name of such a file in a replaced folder `data`
RUN = ".run"  # the folder of an unfinished run's receipts
FRESH = ".fresh"  # an empty file that marks a new folder until the whole replacement is in place
FORMAT: Final = "ibdata-manifest"
VERSION: Final = 1
DATA_VERSION: Final = 2  # raised whenever some experiment gives other rows
SAFE_PATH = re.compile(SAFE_PATH_PATTERN)
WEIGHTS = re.compile(r"meta/policy-[0-9a-f]{16}\.safetensors")  # of networks, named by their SHA-256
MAX_BYTES = 2**32  # of a JSON file, which is read whole
PARTITION = re.compile(r"(episode|step|policy|reward|terminated|truncated|(action|obs|act|next|latent)_\w+)=")
MOVES = 2  # how often a replacement may move a file while a reader looks for it


class NoDatasetError(DatasetError):
    """There is no manifest."""


class OtherVersionError(DatasetError):
    """The dataset was made by an ibdata of another format or data version."""


class ReplacedError(DatasetError):
    """The dataset was replaced after it was opened."""

    exit_code = 75


def read(folder: Path) -> Manifest:
    """Read the manifest of a finished dataset. Raises DatasetError if it is missing or damaged."""
    try:
        data = content(folder, PATH)
    except (FileNotFoundError, NotADirectoryError):
        raise NoDatasetError(
            f"{object_store.name_of(folder)}: no finished dataset here: {PATH} is missing{_near(folder)}"
        ) from None
    except OSError as error:
        raise damaged(folder / PATH, f"cannot be read: {error.strerror}") from None
    return parsed(folder / PATH, data)


def _near(folder: Path) -> str:
    """'; did you mean …?' if a dataset with a similar name is beside the folder, or in a folder `data`."""
    found: dict[str, Path] = {}
    if object_store.name_of(folder) != str(folder):
        return ""  # a URL
    with suppress(OSError, ValueError):
        for base in (folder.parent, folder.parent / "data", Path("data")):
            found |= {path.parents[1].name: path.parents[1] for path in base.glob(f"*/{PATH}")}
    near = nearest(folder.name, found)
    return "" if near is None else f"; did you mean {str(found[near])!r}?"


def parsed(path: Path, data: bytes) -> Manifest:
    """Parse a manifest. Raises DatasetError if it is damaged, OtherVersionError if of another version."""
    found = _json(path, data, "a manifest")
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise damaged(path, f"found another format, expected {FORMAT}")
    if found.get("version") != VERSION:
        shown = printable(repr(found.get("version")))[:60]
        raise OtherVersionError(
            f"{object_store.name_of(path)}: found version {shown}, expected {VERSION}; use a newer ibdata"
        )
    if found.get("checksum") != checksum(found):
        raise damaged(path, "found content that does not fit its checksum; the file has been changed")
    listed = _parsed(path, Manifest, found)
    if listed.data_version != DATA_VERSION:
        raise OtherVersionError(
            f"{object_store.name_of(path)}: found data version {listed.data_version}, expected "
            f"{DATA_VERSION}; make the dataset again with this ibdata"
        )
    return listed


def read_json(folder: Path, listed: Manifest, path: str, form: type[Parsed]) -> Parsed:
    """Read a listed JSON file as a model. Raises DatasetError, or ReplacedError as `listed_content`."""
    return _parsed(folder / path, form, _json(folder / path, listed_content(folder, listed, path), "JSON"))


def listed_content(folder: Path, listed: Manifest, path: str) -> bytes:
    """Read a listed file.

    Raises:
        DatasetError: The file is missing, or has another SHA-256 than the manifest lists.
        ReplacedError: The same, because the dataset or its metadata have been replaced.
    """
    problem = None
    try:
        data = content(folder, path)
    except (FileNotFoundError, NotADirectoryError):
        problem = "missing"
    except OSError as error:
        problem = f"cannot be read: {error.strerror}"
    if problem is None:
        sha256 = next((file.sha256 for file in listed.files if file.path == path), None)
        if hashlib.sha256(data).hexdigest() == sha256:
            return data
        problem = "found other content than the manifest lists"
    refuse_replaced(folder, listed)
    todo = "" if object_store.is_remote(folder) else f"; run ibdata repair {folder}"
    raise damaged(folder / path, f"{problem}{todo}")


def refuse_replaced(folder: Path, listed: Manifest) -> None:
    """Raise ReplacedError if the dataset in the folder no longer has this manifest."""
    try:
        now = read(folder).checksum
    except DatasetError:
        return
    if now != listed.checksum:
        raise ReplacedError(f"{object_store.name_of(folder)}: replaced while it was read; open it again")


def _json(path: Path, data: bytes, what: str) -> Any:
    try:
        return _encodable(json.loads(data, parse_constant=_no_constant, parse_float=_finite))
    except (ValueError, RecursionError) as error:
        raise damaged(path, f"found no valid JSON ({error}), expected {what}") from None


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is not a JSON number")


def _encodable(data: Any) -> Any:
    """Return JSON data unchanged. Raises ValueError for half a surrogate pair, which UTF-8 cannot encode."""
    try:
        json.dumps(data, ensure_ascii=False).encode()
    except UnicodeEncodeError as error:
        raise ValueError(f"{error.object[error.start]!r} is half a surrogate pair") from None
    return data


def _finite(digits: str) -> float:
    number = float(digits)
    if math.isinf(number):
        raise ValueError(f"{digits[:40]} is too large a number")
    return number


def _parsed(path: Path, form: type[Parsed], data: Any) -> Parsed:
    try:
        return parse(form, data)
    except ValueError as error:
        raise damaged(path, str(error)) from None


def locate(folder: Path, path: str) -> Path:
    """The path of a file of the dataset: in its place, or in `.new` while the dataset is being replaced.

    A file that holds only `BAR` is passed over: it is there to make readers of the folder fail.
    """
    object_store.fetch_if_missing(folder, path)
    for place in (folder / path, folder / NEW / path, folder / NEW / f"old-{path}"):
        with suppress(OSError):
            status = place.lstat()
            if status.st_size > len(BAR) or not stat.S_ISREG(status.st_mode):
                return place
    return folder / path


def content(folder: Path, path: str) -> bytes:
    """Read a file of the dataset, even while a replacement moves it. Raises OSError."""
    for _ in range(MOVES):
        with suppress(FileNotFoundError):
            return plain_bytes(locate(folder, path), MAX_BYTES)
    return plain_bytes(locate(folder, path), MAX_BYTES)


def refuse_inside(out: Path) -> None:
    """Raise UsageError for an output in a place in which readers of a dataset could be misled.

    It is in a dataset, finished or not, of which the folders `.next` and `.new` are a part; or it is in a
    folder such as `policy=safe`, from whose name readers of partitioned datasets would take the column. Or it
    is no place, for no path contains NUL.
    """
    if "\0" in str(out):
        raise UsageError(f"--out: found {str(out)!r}, expected a path without NUL")
    place = Path(os.path.realpath(out))
    if column := next((part for part in place.parts if PARTITION.match(part)), None):
        raise UsageError(
            f"{out}: found the folder {column}, from whose name some readers would take the values of "
            "a column; choose another name, without ="
        )
    signs = (PATH, f"{RUN}/experiment.yaml", f"{NEXT}/{MARK}", f"{NEW}/{MARK}")
    for folder in place.parents:
        if any(os.path.isfile(folder / path) for path in signs):
            raise UsageError(f"{out}: lies within the dataset {folder}; choose a place outside of it")
    if place.name in (NEXT, NEW):
        raise UsageError(
            f"{out}: found the name {place.name}, which is kept for replacing the dataset in the folder "
            "around it; choose another"
        )


def sealed(listed: Manifest) -> Manifest:
    """The manifest with its checksum."""
    return listed.model_copy(update={"checksum": checksum(listed.plain())})


def checksum(data: Mapping[str, Any]) -> str:
    """The SHA-256 of a manifest without its checksum, as JSON with sorted keys."""
    rest = {key: value for key, value in data.items() if key != "checksum"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()
