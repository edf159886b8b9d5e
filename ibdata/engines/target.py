"""The output folder: what it holds, what may be written there, and what is taken away again."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ibdata.dataset import manifest, receipt
from ibdata.dataset.files import TEMPORARY, plain_bytes, sweep, write, write_once
from ibdata.engines import lock
from ibdata.errors import DatasetError, UsageError
from ibdata.experiment import Experiment, as_yaml
from ibdata.experiment.plan import Shard

EXPERIMENT = f"{receipt.FOLDER}/experiment.yaml"
RANGE_LOCK = f"{lock.NAME}-"


def identity(experiment: Experiment) -> str:
    """What a run must share with another to be resumed by it."""
    return hashlib.sha256(as_yaml(experiment) + bytes([manifest.DATA_VERSION])).hexdigest()


def meant(out: str | os.PathLike[str]) -> Path:
    """The folder that is meant; `..` after a folder that there is not leads back to where that would be."""
    folder = Path(out)
    return folder if os.path.exists(folder.parent) else Path(os.path.normpath(folder))


def check(folder: Path, experiment: Experiment, resume: bool, overwrite: bool) -> Path:
    """Where the run is to be written: the folder, or `.next` in it where a dataset is to be replaced.

    Raises UsageError for a folder that may not be written to.
    """
    if resume and overwrite:
        raise UsageError("found --resume with --overwrite, expected one of them")
    if "\0" in str(folder):
        raise UsageError(f"--out: found {str(folder)!r}, expected a path without NUL")
    if not os.path.lexists(folder):
        return folder
    if not folder.is_dir():
        raise UsageError(f"{folder}: found a file, expected a folder or nothing; choose another --out")
    refuse_links(folder)
    empty = not any(_counts(path) for path in folder.iterdir())  # first: another range may begin meanwhile
    if (folder / EXPERIMENT).is_file() and not manifest.locate(folder, manifest.PATH).is_file():
        return _unfinished(folder, experiment, resume, overwrite)
    if empty:
        return folder
    return _finished(folder, experiment, resume, overwrite)


def _counts(path: Path) -> bool:
    """Whether it is more than what a run leaves that was killed before it had said whose it is."""
    if path.name == receipt.FOLDER and path.is_dir():
        return any(not inner.name.startswith(TEMPORARY) for inner in path.iterdir())
    return path.name != lock.NAME and not path.name.startswith(RANGE_LOCK)


def refuse_links(folder: Path) -> None:
    """A folder of ours that is a link would lead writing and deleting out of the dataset."""
    inner = ("data", "meta", receipt.FOLDER)
    parts = [Path(), Path(manifest.NEXT), Path(manifest.NEW)]
    for path in (*parts[1:], *(part / name for part in parts for name in inner)):
        if (folder / path).is_symlink():
            raise UsageError(f"{folder / path}: found a link, expected a folder; remove it")


def _unfinished(folder: Path, experiment: Experiment, resume: bool, overwrite: bool) -> Path:
    if overwrite:
        return folder
    if not resume:
        raise UsageError(
            f"{folder}: holds an unfinished run; --resume to go on with it, or --overwrite to start again"
        )
    if (folder / EXPERIMENT).read_bytes() != as_yaml(experiment):
        raise UsageError(
            f"{folder}: holds an unfinished run of another experiment; --overwrite to start again"
        )
    return folder


def _finished(folder: Path, experiment: Experiment, resume: bool, overwrite: bool) -> Path:
    if not (resume or overwrite):
        raise UsageError(
            f"{folder}: exists already; choose another --out, or --overwrite to replace a dataset"
        )
    try:
        listed = manifest.read(folder)
    except DatasetError as error:
        raise UsageError(f"{folder}: not a dataset of ibdata, left as it is ({error})") from None
    if overwrite:
        _refuse_strangers(folder, listed)
        return folder / manifest.NEXT
    if not _holds(manifest.locate(folder, manifest.EXPERIMENT), as_yaml(experiment)):
        raise UsageError(f"{folder}: holds the dataset of another experiment; --overwrite to replace it")
    for file in listed["files"]:
        path = manifest.locate(folder, file["path"])
        if not path.is_file() or path.stat().st_size != file["bytes"]:
            raise DatasetError(f"{path}: missing or of another size than listed; ibdata repair {folder}")
    return folder


def _holds(path: Path, data: bytes) -> bool:
    """Whether it is a regular file with these bytes; a pipe would be read for ever."""
    try:
        return plain_bytes(path, len(data)) == data
    except OSError:
        return False


def _refuse_strangers(folder: Path, listed: dict[str, Any]) -> None:
    known = {file["path"] for file in listed["files"]} | manifest.outgoing(folder)
    for part in (folder / "data", folder / manifest.NEW / "data"):
        for path in part.glob("*"):
            if f"data/{path.name}" not in known and not path.name.startswith("."):
                raise UsageError(
                    f"{path}: found a file that is not the dataset's, expected none; move it away"
                )


def begin(root: Path, experiment: Experiment, overwrite: bool) -> None:
    """Make the run's folder, take away what does not belong to this experiment, and say whose it is."""
    mine = root / EXPERIMENT
    if (
        not mine.is_file()
        or (overwrite and root.name != manifest.NEXT)
        or mine.read_bytes() != as_yaml(experiment)
    ):
        discard(root)
    root.mkdir(exist_ok=True)
    for part in (root, root / "data", root / "meta", root / receipt.FOLDER):
        sweep(part)
    if not mine.is_file():
        write(root, EXPERIMENT, as_yaml(experiment))


def begin_range(root: Path, experiment: Experiment, shards: Sequence[Shard]) -> None:
    """As `begin`, for some of the shards, while others may be written: only what was theirs is taken away.

    Raises UsageError where another experiment was begun here meanwhile.
    """
    sweep_shards(root, shards)
    if not write_once(root, EXPERIMENT, as_yaml(experiment)):
        raise UsageError(f"{root}: holds an unfinished run of another experiment; choose another --out")


def sweep_shards(root: Path, shards: Iterable[Shard]) -> None:
    """Remove what killed writers of these shards had begun."""
    names = {Path(path).name for shard in shards for path in (shard.file, receipt.path_of(shard))}
    for part in ("data", receipt.FOLDER):
        sweep(root / part, names)


def end(root: Path) -> None:
    """Take the receipts away: the manifest has what they say."""
    _empty(root / receipt.FOLDER)
    for left in root.glob(f"{RANGE_LOCK}*"):  # of ranges that were killed
        left.unlink(missing_ok=True)


def abandon(root: Path) -> None:
    """After a failure: keep what --resume can use, the shards that have receipts; else keep nothing."""
    for part in (root, root / "data", root / "meta", root / receipt.FOLDER):
        sweep(part)
    if not list((root / receipt.FOLDER).glob("*.receipt")):
        discard(root)


def discard(root: Path) -> None:
    """Remove an unfinished run: its shards, metadata and receipts; nothing else."""
    if not root.is_dir() or root.is_symlink():
        return
    staged = root.name == manifest.NEXT
    for place in (root, root / "data", root / "meta"):
        sweep(place)
    for part in ("data", "meta"):
        folder = root / part
        names = (*manifest.METADATA, *([manifest.PATH] if staged else []))
        for pattern in ("part-*.parquet", "experiment-*.yaml", *(Path(path).name for path in names)):
            for path in folder.glob(pattern) if not folder.is_symlink() else ():
                path.unlink()
        if folder.is_dir() and not folder.is_symlink() and not any(folder.iterdir()):
            folder.rmdir()
    for name in (manifest.CARD, manifest.REPORT):
        (root / name).unlink(missing_ok=True)
    _empty(root / receipt.FOLDER)
    if staged:
        root.rmdir()


def _empty(folder: Path) -> None:
    if folder.is_dir() and not folder.is_symlink():
        said = folder / Path(EXPERIMENT).name  # last: it says whose run this is while anything is left of it
        for inner in (*(inner for inner in folder.iterdir() if inner != said), said):
            inner.unlink(missing_ok=True)
        folder.rmdir()
