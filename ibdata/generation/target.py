"""The place of a dataset: what is there, what was begun for it, and what a run does with both."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from enum import Enum
from pathlib import Path
from typing import NamedTuple

from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.errors import DatasetError, UsageError
from ibdata.experiment import Experiment, as_yaml
from ibdata.experiment.code import changed_here, names_of
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.generation.record import Record, difference
from ibdata.policies.live import without_runs
from ibdata.system.files import part_of, paths_in
from ibdata.system.part import Part, refusals, resolved
from ibdata.writing.edited import EDITABLE, is_users


class TakenError(UsageError):
    """The place is not empty, and the options do not say what is to become of its contents."""


class Target:
    """The place at which a dataset is to appear.

    Attributes:
        path: The place without links, which may lead to another disk.
        name: Its name in messages.
    """

    def __init__(self, place: str | os.PathLike[str], name: Path | None = None) -> None:
        self.path, self.name = resolved(place), name or Path(place)

    @property
    def part(self) -> Part:
        """The part, in which the dataset is made."""
        return Part(self.path)

    @property
    def is_free(self) -> bool:
        """Whether there is nothing but perhaps an empty folder."""
        with refusals(self.name):
            return not self.path.is_dir() or not paths_in(self.path)

    def refuse(self) -> None:
        """Raise UsageError if no dataset can appear here by a rename."""
        manifest.refuse_inside(self.path)
        refuse_name(self.name.parts, self.name)
        here = Path.cwd()
        if self.path == here or self.path in here.parents:
            raise UsageError(f"{self.name}: is the current folder or around it; choose another --out")
        if os.path.ismount(self.path):
            raise UsageError(
                f"{self.name}: is a mount point, which cannot be replaced; choose a folder in it"
            )
        there = next(path for path in (self.path, *self.path.parents) if os.path.lexists(path))
        if not there.is_dir():
            where = "is" if there == self.path else "lies in"
            raise UsageError(f"{self.name}: {where} a file, not a folder; choose another --out")

    def refuse_taken(self) -> None:
        """Raise UsageError if there is anything but an empty folder."""
        self.refuse()
        if not self.is_free:
            raise UsageError(f"{self.name}: exists already; choose another --out")

    def size(self, path: str) -> int | None:
        """The bytes of a file of the dataset; None if there is no such file."""
        file = self.path / path
        return file.stat().st_size if file.is_file() else None


def refuse_name(parts: Sequence[str], place: str | os.PathLike[str]) -> None:
    """Raise UsageError for a place whose name readers take for a column, or for a single Parquet file."""
    manifest.refuse_partition(parts, place)
    if parts and parts[-1].lower().endswith(".parquet"):
        raise UsageError(
            f"{place}: found the ending .parquet, but a dataset is a folder; leave .parquet out (read its "
            "files at data/*.parquet)"
        )


class At(Enum):
    """What is at a target."""

    FREE = "nothing"
    SAME = "the dataset of this experiment"
    OTHER = "another dataset"
    FOREIGN = "what ibdata did not make"


class Begun(Enum):
    """What a run has begun in the part of a target."""

    NOTHING = "nothing"
    SAME = "this run"
    OTHER = "another run"


class Mode(Enum):
    """What the options allow a run to do."""

    NEW = "without options"
    RESUME = "--resume"
    OVERWRITE = "--overwrite"

    @classmethod
    def of(cls, resume: bool, overwrite: bool) -> Mode:
        """The mode of two options. Raises UsageError if both are given."""
        if resume and overwrite:
            raise UsageError("--resume and --overwrite exclude each other; give one of them")
        return cls.RESUME if resume else cls.OVERWRITE if overwrite else cls.NEW


class Action(Enum):
    """What a run does."""

    OPEN = "open the finished dataset"
    BEGIN = "begin"
    GO_ON = "go on with the unfinished run"
    DISCARD = "discard the unfinished run, and begin"


class Found(NamedTuple):
    """What is at a target, and what was begun for it. The texts are for messages."""

    name: Path | str  # of the target
    at: At
    begun: Begun = Begun.NOTHING
    why: str = ""  # what the dataset or folder is, and what can be done
    damage: str | None = None  # of the dataset
    in_the_way: str | None = None  # of replacing it: somebody's file, or the mode of a folder
    other_code: str = ""  # the files in which the dataset's code differs from what is here
    run: str | None = None  # how the run that was begun differs


def decide(found: Found, mode: Mode) -> Action:
    """What a run does with what was found at its target.

    Raises:
        TakenError: The options do not say what is to become of it.
        UsageError: It may not be replaced.
        DatasetError: The dataset is damaged.
    """
    name, at = found.name, found.at
    if at is At.FOREIGN:
        raise UsageError(f"{name}: {found.why}")
    if mode is Mode.OVERWRITE:
        if found.in_the_way:
            raise UsageError(found.in_the_way)
    elif at is At.OTHER:
        raise TakenError(f"{name}: {found.why}")
    elif at is At.SAME:
        if found.damage:
            raise DatasetError(found.damage)
        if found.other_code and mode is Mode.NEW:
            raise TakenError(
                f"{name}: holds the dataset of this experiment with other code, in {found.other_code}; "
                "--overwrite to make it again"
            )
        return Action.OPEN
    if found.begun is Begun.NOTHING:
        return Action.BEGIN
    if found.begun is Begun.SAME:
        if mode is Mode.NEW:
            raise TakenError(f"{name}: holds an unfinished run; --resume to go on with it")
        return Action.GO_ON
    if mode is not Mode.OVERWRITE:
        raise TakenError(
            f"{name}: holds an unfinished run {found.run}; --overwrite to start again, or choose another "
            "--out"
        )
    return Action.DISCARD


def look(
    target: Target, spec: DatasetSpec, record: Record | None = None, *, with_part: bool = False
) -> Found:
    """What is at the target of a dataset, and on demand, what was begun in its part.

    Without a record of this process, a run is known by its experiment only.
    Raises UsageError if no dataset can appear at the target.
    """
    target.refuse()
    with refusals(target.name):
        found = Found(target.name, At.FREE) if target.is_free else _found_at(target, spec)
        if with_part and target.part.receipts:
            run = difference(target.part.folder, spec.experiments[0], record)
            found = found._replace(begun=Begun.SAME if run is None else Begun.OTHER, run=run)
    return found


def _found_at(target: Target, spec: DatasetSpec) -> Found:
    """What is at a target that is not free."""
    name, [experiment] = target.name, spec.experiments
    try:
        listed = manifest.read(target.path)
    except DatasetError as error:
        why = "" if isinstance(error, manifest.NoDatasetError) else f" ({error})"
        why = f"not a dataset of ibdata, left as it is{why}; move it away, or choose another --out"
        return Found(name, At.FOREIGN, why=why)
    in_the_way = _in_the_way(target.path, listed)
    if not is_of(listed, experiment):
        return Found(name, At.OTHER, why=_other(listed, experiment), in_the_way=in_the_way)
    return Found(
        name,
        At.SAME,
        damage=damage(listed, target.size, name),
        in_the_way=in_the_way,
        other_code=names_of(changed_here(spec, listed.code)),
    )


def is_of(listed: Manifest, experiment: Experiment) -> bool:
    """Whether a dataset is that of an experiment. A merged dataset is not."""
    entry = listed.entries().get(manifest.EXPERIMENT)
    return entry is not None and entry.sha256 == hashlib.sha256(as_yaml(experiment)).hexdigest()


def _other(listed: Manifest, experiment: Experiment) -> str:
    """Which other dataset a manifest lists, and what can be done."""
    if [without_runs(plain) for plain in listed.experiments] == [without_runs(experiment.plain())]:
        return (
            "holds the dataset of another object of this Python session, or of the same before it changed; "
            "--overwrite to make it with this one, or choose another --out"
        )
    return "holds the dataset of another experiment; --overwrite to replace it"


def damage(listed: Manifest, size_of: Callable[[str], int | None], name: Path | str) -> str | None:
    """The first file that a manifest lists and that is missing or has another size, with the remedy."""
    for path, entry in listed.entries().items():
        if size_of(path) != entry.bytes:
            return (
                f"{name}/{path}: missing or not whole, but the dataset is finished; ibdata repair makes the "
                "file again, --overwrite the dataset"
            )
    return None


def _in_the_way(folder: Path, listed: Manifest) -> str | None:
    """The problem of replacing a dataset: more than it is in its folder, or the mode of a folder."""
    for path in foreign_files(folder, listed):
        what = "folder" if path.is_dir() else "file"
        return f"{path}: found a {what} that is not the dataset's; move it away"
    for parent in (folder.parent, folder, folder / "data", folder / "meta"):
        if not os.access(parent, os.W_OK | os.X_OK):
            return f"{parent}: cannot be written, expected a folder that --overwrite may replace"
    return None


def foreign_files(folder: Path, listed: Manifest) -> Iterator[Path]:
    """What is in a dataset's folder that is neither the dataset's nor a file that a user may edit."""
    known = {*listed.entries(), manifest.PATH, manifest.SPLITS, *EDITABLE}
    known |= {str(part_of(Path(path))) for path in known}  # of a writer that was killed
    for path in paths_in(folder):
        if path.name in ("data", "meta") and path.is_dir():
            yield from (inner for inner in paths_in(path) if f"{path.name}/{inner.name}" not in known)
        elif not path.is_file() or not (path.name in known or is_users(path.name)):
            yield path
