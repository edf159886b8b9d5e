"""The place of a dataset: what may be there before a run begins, and what the run would do with it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.dataset.stored import Stored
from ibdata.errors import DatasetError, UsageError
from ibdata.experiment import Experiment, as_yaml
from ibdata.policies.live import without_runs
from ibdata.system.files import part_of
from ibdata.system.part import refusals
from ibdata.system.storage import Storage
from ibdata.writing.edited import EDITABLE, is_users


class TakenError(UsageError):
    """The place is not empty, and the options do not say what is to become of its contents."""


def refuse_place(target: Path, place: Path) -> None:
    """Raise UsageError for a place at which no dataset can appear by a rename.

    Args:
        target: The place without links.
        place: Its name in messages.
    """
    manifest.refuse_inside(target)
    refuse_name(place.parts, place)
    here = Path.cwd()
    if target == here or target in here.parents:
        raise UsageError(f"{place}: is the current folder or around it; choose another --out")
    if os.path.ismount(target):
        raise UsageError(f"{place}: is a mount point, which cannot be replaced; choose a folder in it")
    there = next(path for path in (target, *target.parents) if os.path.lexists(path))
    if not there.is_dir():
        where = "is" if there == target else "lies in"
        raise UsageError(f"{place}: {where} a file, not a folder; choose another --out")


def refuse_name(parts: Sequence[str], place: str | os.PathLike[str]) -> None:
    """Raise UsageError for a place whose name readers take for a column, or for a single Parquet file."""
    manifest.refuse_partition(parts, place)
    if parts and parts[-1].lower().endswith(".parquet"):
        raise UsageError(
            f"{place}: found the ending .parquet, but a dataset is a folder; leave .parquet out (read its "
            "files at data/*.parquet)"
        )


def refuse_incomplete(listed: Manifest, size_of: Callable[[str], int | None], place: Path | str) -> None:
    """Raise DatasetError if a file that a manifest lists is missing or has another size."""
    for path, entry in listed.entries().items():
        if size_of(path) != entry.bytes:
            raise DatasetError(
                f"{place}/{path}: missing or not whole, but the dataset is finished; ibdata repair makes the "
                "file again, --overwrite the dataset"
            )


def size_in(folder: Path, path: str) -> int | None:
    """The bytes of a file in a folder; None if there is none."""
    file = folder / path
    return file.stat().st_size if file.is_file() else None


def is_free(target: Path, place: Path) -> bool:
    """Whether there is nothing at a place but perhaps an empty folder."""
    with refusals(place):
        return not target.is_dir() or not any(target.iterdir())


def refuse_taken(target: Path, place: Path) -> None:
    """Raise UsageError if there is anything at a place but an empty folder."""
    refuse_place(target, place)
    if not is_free(target, place):
        raise UsageError(f"{place}: exists already; choose another --out")


def present(target: Path, place: Path, experiment: Experiment, overwrite: bool) -> Manifest | None:
    """The manifest of the dataset at a place if it is this experiment's; None if a run is to make it.

    Raises:
        UsageError: Something else is there that may not be replaced.
        TakenError: The dataset of another experiment is there, which --overwrite would replace.
    """
    refuse_place(target, place)
    if is_free(target, place):
        return None
    try:
        listed = manifest.read(target)
    except DatasetError as error:
        why = "" if isinstance(error, manifest.NoDatasetError) else f" ({error})"
        raise UsageError(
            f"{place}: not a dataset of ibdata, left as it is{why}; move it away, or choose another --out"
        ) from None
    if overwrite:
        _refuse_irreplaceable(target, listed)
        return None
    if manifest.EXPERIMENT not in listed.entries():
        same = False  # a merged dataset
    else:
        same = Stored(Storage(target), listed).read(manifest.EXPERIMENT) == as_yaml(experiment)
    if not same and [without_runs(each) for each in listed.experiments] == [without_runs(experiment.plain())]:
        raise TakenError(
            f"{place}: holds the dataset of another object of this Python session, or of the same before it "
            "changed; --overwrite to make it with this one, or choose another --out"
        )
    if not same:
        raise TakenError(f"{place}: holds the dataset of another experiment; --overwrite to replace it")
    return listed


def _refuse_irreplaceable(target: Path, listed: Manifest) -> None:
    """Raise UsageError for a folder that may not be replaced, or that holds more than a dataset."""
    for path in strangers(target, listed):
        what = "folder" if path.is_dir() else "file"
        raise UsageError(f"{path}: found a {what} that is not the dataset's; move it away")
    for folder in (target.parent, target, target / "data", target / "meta"):
        if not os.access(folder, os.W_OK | os.X_OK):
            raise UsageError(f"{folder}: cannot be written, expected a folder that --overwrite may replace")


def strangers(target: Path, listed: Manifest) -> Iterator[Path]:
    """What is in a dataset's folder that is neither the dataset's nor a file that a user may edit."""
    known = {*listed.entries(), manifest.PATH, manifest.SPLITS, *EDITABLE}
    known |= {str(part_of(Path(path))) for path in known}  # of a writer that was killed
    for path in sorted(target.iterdir()):
        if path.name in ("data", "meta") and path.is_dir():
            yield from (inner for inner in sorted(path.iterdir()) if f"{path.name}/{inner.name}" not in known)
        elif path.name not in known and not is_users(path.name):
            yield path
