"""Reading meta/manifest.json, which is written last and lists the files of a finished dataset."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from ibdata._system.configs import shipped
from ibdata._system.runs import Run, note_of, runs_at
from ibdata._system.storage import Storage, in_data, local, storage
from ibdata.dataset.models import Manifest, parse
from ibdata.errors import OUT, DatasetError, IbdataError, UsageError, nearest, printable, reason

PATH = "meta/manifest.json"
EXPERIMENT = "meta/experiment.yaml"
SPLITS = "meta/splits.json"
CROISSANT = "meta/croissant.json"
CARD = "README.md"
REPORT = "report.html"  # only after `ibdata card`
FORMAT: Final = "ibdata-manifest"
VERSION: Final = 2
DATA_VERSION: Final = 3  # raised whenever some experiment gives other rows
WEIGHTS = re.compile(r"meta/policy-[0-9a-f]{16}\.safetensors")  # of networks, named by their SHA-256
PARTITION = re.compile(
    r"(episode|step|policy|reward|terminated|truncated|(action|obs|act|next|latent)_\w+)=", re.IGNORECASE
)


class NoDatasetError(DatasetError):
    """There is no manifest."""


def read(place: Any) -> Manifest:
    """Read the manifest of a finished dataset in a folder or at a URL.

    Raises DatasetError if it is missing or damaged, or of another version.
    """
    files = storage(place)
    try:
        data = files.read(PATH)
    except (FileNotFoundError, NotADirectoryError):
        raise NoDatasetError(
            f"{files.name}: no finished dataset here: {PATH} is missing{_remedy(files)}"
        ) from None
    except OSError as error:
        raise files.error(PATH, f"cannot be read: {reason(error)}") from None
    try:
        return _parsed(data)
    except ValueError as error:
        raise files.error(PATH, str(error)) from None


def _remedy(files: Storage) -> str:
    """What may have been meant: a dataset in data/, around or beside the place, or one to be made."""
    if "*" in files.name:
        return f"; ibdata.open takes a list of places, such as sorted(glob.glob({files.name!r}))"
    below = Path(files.name) if files.url else in_data(Path(files.name)) or Path(files.name)
    for place in [files] if files.url else [files, Storage(below)]:
        with suppress(OSError, IbdataError):  # not ours to read, or no name that the system knows
            for run in runs_at(place):
                if is_unfinished(run, place):
                    is_of_this = note_of(run).get("data_version") == DATA_VERSION
                    goes_on = ", and the same command goes on" if is_of_this else ""
                    done, shards = progress(run)
                    return f"; an unfinished run has {done} of {shards} shards here{goes_on}"
    if files.url:
        return ""
    folder = Path(files.name)
    for near in (below, *folder.parents):
        if os.path.isfile(local(near) / PATH):
            return f"; did you mean {str(near)!r}?"
    name = folder.as_posix().removeprefix("data/")
    if name in shipped():
        return f"; ibdata generate --config {name} makes data/{name}"
    if any(folder.glob(f"*/{PATH}")):
        return f"; ibdata ls {folder} lists the datasets in it"
    if any(config.startswith(f"{name}/") for config in shipped()):
        return f"; ibdata generate --config {name} makes the datasets of data/{name}"
    folders: dict[str, Path] = {}
    with suppress(OSError, ValueError):
        for base in (folder.parent, folder.parent / "data", Path("data")):
            folders |= {path.parents[1].name: path.parents[1] for path in base.glob(f"*/{PATH}")}
    known = nearest(folder.name, folders)
    return "" if known is None else f"; did you mean {str(folders[known])!r}?"


def _parsed(data: bytes) -> Manifest:
    entries = loads(data)
    if not isinstance(entries, dict) or entries.get("format") != FORMAT:
        raise ValueError(f"found another format, expected {FORMAT}")
    for key, expected in (("version", VERSION), ("data_version", DATA_VERSION)):
        if entries.get(key) != expected:
            shown = printable(repr(entries.get(key)))[:60]
            name = key.replace("_", " ")
            newer = isinstance(entries.get(key), int) and entries[key] > expected
            todo = "update ibdata" if newer else "make the dataset again with this ibdata"
            raise ValueError(f"found {name} {shown}, expected {expected}; {todo}")
    if entries.get("checksum") != checksum(entries):
        raise ValueError("found content that does not fit its checksum; the file has been changed")
    return parse(Manifest, entries)


def loads(data: bytes) -> Any:
    """Parse JSON. Raises ValueError if it is none."""
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"found no valid JSON ({error})") from None


def refuse_inside(out: Path) -> None:
    """Raise UsageError for an output in a place in which readers of a dataset could be misled.

    It is in a dataset; or it is in a folder such as `policy=safe`, from whose name readers of partitioned
    datasets would take the column. Or it is no place, for no path contains NUL.
    """
    if "\0" in str(out):
        raise UsageError(f"{OUT}: found {str(out)!r}, expected a path without NUL")
    path, place = local(out), Path(os.path.realpath(local(out)))
    refuse_partition([*path.absolute().parts, *place.parts], out)
    for folder in place.parents:
        if os.path.isfile(folder / PATH):
            raise UsageError(f"{out}: lies within the dataset {folder}; choose a place outside of it")


def refuse_partition(parts: Iterable[str], out: str | os.PathLike[str]) -> None:
    """Raise UsageError if readers would take one of these names of folders for the values of a column."""
    if column := next((part for part in parts if PARTITION.match(part)), None):
        raise UsageError(
            f"{out}: found the folder {column}, from whose name some readers would take the values of "
            "a column; choose another name, without ="
        )


def refuse_name(parts: Sequence[str], place: str | os.PathLike[str]) -> None:
    """Raise UsageError for a place whose name readers take for a column, or for a single Parquet file."""
    refuse_partition(parts, place)
    if parts and parts[-1].lower().endswith(".parquet"):
        raise UsageError(
            f"{place}: found the ending .parquet, but a dataset is a folder; leave .parquet out (read its "
            "files at data/*.parquet)"
        )


def is_unfinished(run: Run, files: Storage) -> bool:
    """Whether a run at a place has finished shards with which somebody may go on.

    Nobody goes on with a run in which an object of a Python session acts, or with one that was published.
    """
    note = note_of(run)
    if not run.receipts() or note.get("live"):
        return False
    if (noted := note.get("manifest")) is None:
        return True
    if (made := run.dataset()) is None or checksum_in(files) == noted:
        return False
    return checksum_in(made) in (None, noted)  # else it was replaced, by the exchange


def unfinished(files: Storage) -> list[Run]:
    """The runs beside a place that have finished shards, with which somebody may go on."""
    return [run for run in runs_at(files) if is_unfinished(run, files)]


def just_begun(files: Storage) -> list[Run]:
    """The runs beside a place that have no finished shard yet."""
    return [run for run in runs_at(files) if not run.receipts() and note_of(run).get("live") is False]


def progress(run: Run) -> tuple[int, int | str]:
    """How many shards of a run are finished, and how many it has, or "?"."""
    shards = note_of(run).get("shards")
    return len(run.receipts()), shards if isinstance(shards, int) else "?"


def checksum_in(files: Storage) -> str | None:
    """The checksum of the manifest at a place; None if there is none that can be read."""
    with suppress(OSError, ValueError):
        return _parsed(files.read(PATH)).checksum
    return None


def sealed(manifest: Manifest) -> Manifest:
    """The manifest with its checksum."""
    return manifest.model_copy(update={"checksum": checksum(manifest.plain())})


def checksum(data: Mapping[str, Any]) -> str:
    """The SHA-256 of a manifest without its checksum, as JSON with sorted keys."""
    rest = {key: value for key, value in data.items() if key != "checksum"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()
