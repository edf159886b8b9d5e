"""The output folder: checking it before a run, preparing it, and cleaning it up."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.dataset.strangers import strangers
from ibdata.errors import DatasetError, IbdataError, UsageError
from ibdata.experiment import Experiment, as_yaml
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.generation import receipt, staging
from ibdata.generation.single_files import refuse_edits
from ibdata.generation.staging import discard, empty_run
from ibdata.system import lock
from ibdata.system.atomic_files import TEMPORARY, create_or_compare, remove_temporaries, write
from ibdata.validation.files import check_files
from ibdata.writing.card import refuse_foreign
from ibdata.writing.shard_writer import WrittenShard

EXPERIMENT = staging.EXPERIMENT


class TakenError(UsageError):
    """The output folder is not empty, and the options do not say what is to become of its contents."""


RANGE_LOCK = f"{lock.NAME}-"
GATE = f"{RANGE_LOCK}gate"
RANGE_LOCKS = re.compile(re.escape(RANGE_LOCK) + "(?:gate|([1-9][0-9]{0,8})-([1-9][0-9]{0,8}))")


def identity(experiment: Experiment) -> str:
    """The hash that a run must have in common with the run that it resumes."""
    return _hashed(as_yaml(experiment))


def _hashed(experiment: bytes) -> str:
    return hashlib.sha256(experiment + bytes([manifest.DATA_VERSION])).hexdigest()


def resolved(out: str | os.PathLike[str]) -> Path:
    """The output folder. If its parent does not exist, each `..` is resolved in the text of the path."""
    folder = Path(out)
    return folder if os.path.exists(folder.parent) else Path(os.path.normpath(folder))


def check(folder: Path, experiment: Experiment, resume: bool, overwrite: bool) -> Path:
    """The folder to write to: the output folder, or `.next` in it if a dataset is to be replaced.

    Raises UsageError for a folder that may not be written to.
    """
    if resume and overwrite:
        raise UsageError("--resume and --overwrite exclude each other; give one of them")
    manifest.refuse_inside(folder)
    if not os.path.lexists(folder):
        return folder
    if not folder.is_dir():
        raise UsageError(f"{folder}: is a file, not a folder; choose another --out")
    refuse_links(folder)
    empty = all(_is_leftover(path) for path in folder.iterdir())  # first: another range may begin meanwhile
    if (folder / EXPERIMENT).is_file() and not manifest.locate(folder, manifest.PATH).is_file():
        return _unfinished(folder, experiment, resume, overwrite)
    if empty or os.path.lexists(folder / manifest.NEW):  # an interrupted replacement is finished first
        return folder
    return _finished(folder, experiment, resume, overwrite)


def outlook(folder: Path, experiment: Experiment, resume: bool, overwrite: bool) -> str | None:
    """Say what `generate` would do with an output folder that exists; None if it is new or empty.

    Raises what `check` raises, except TakenError.
    """
    try:
        root = check(folder, experiment, resume, overwrite)
    except TakenError as error:
        return f"generate would stop with: {error.with_options}"
    if root != folder:
        return "exists; generate would replace the dataset in it"
    if (folder / manifest.PATH).is_file():
        return "exists; generate would find the dataset finished, and write nothing"
    if (folder / EXPERIMENT).is_file():
        return f"exists; generate would {'discard' if overwrite else 'go on with'} the unfinished run in it"
    return None


def _is_leftover(path: Path) -> bool:
    """Whether a path was left by a run that was killed before it noted its experiment."""
    if path.name == receipt.FOLDER and path.is_dir():
        return not any(path.iterdir())
    return path.name == lock.NAME or path.name.startswith((RANGE_LOCK, TEMPORARY))


def refuse_links(folder: Path) -> None:
    """Raise UsageError if an inner folder is a link: files elsewhere could be written or removed."""
    inner = ("data", "meta", "old-data", "old-meta", receipt.FOLDER)
    parts = [Path(), Path(manifest.NEXT), Path(manifest.NEW)]
    for path in (*parts[1:], *(part / name for part in parts for name in inner)):
        if (folder / path).is_symlink():
            raise UsageError(f"{folder / path}: found a link, expected a folder; remove it")
    for part in parts[1:]:
        staging.refuse_foreign(folder / part)


def refuse_unsettled(folder: Path) -> None:
    """Raise UsageError if a replacement was interrupted, which must be finished first."""
    if os.path.lexists(folder / manifest.NEW):
        raise UsageError(f"{folder}: a replacement was interrupted here; ibdata repair {folder} finishes it")


def _unfinished(folder: Path, experiment: Experiment, resume: bool, overwrite: bool) -> Path:
    if overwrite:
        return folder
    if not resume:
        raise TakenError(
            f"{folder}: holds an unfinished run; --resume to go on with it, or --overwrite to start again"
        )
    if (folder / EXPERIMENT).read_bytes() != as_yaml(experiment):
        raise TakenError(
            f"{folder}: holds an unfinished run of another experiment; --overwrite to start again"
        )
    return folder


def _finished(folder: Path, experiment: Experiment, resume: bool, overwrite: bool) -> Path:
    if not (resume or overwrite):
        raise TakenError(
            f"{folder}: exists already; choose another --out, or --overwrite to replace a dataset"
        )
    try:
        listed = manifest.read(folder)
    except DatasetError as error:
        raise UsageError(f"{folder}: not a dataset of ibdata, left as it is ({error})") from None
    if overwrite:
        _refuse_strangers(folder, listed)
        return folder / manifest.NEXT
    if manifest.listed_content(folder, listed, manifest.EXPERIMENT) != as_yaml(experiment):
        raise TakenError(f"{folder}: holds the dataset of another experiment; --overwrite to replace it")
    for problem in check_files(folder, listed):
        if problem.path in listed.entries():
            raise DatasetError(f"{folder / problem.path}: damaged or missing; run ibdata repair {folder}")
    return folder


def _refuse_strangers(folder: Path, listed: Manifest) -> None:
    known = listed.entries()
    for path in strangers(folder, known):
        what = "folder" if path.endswith("/") else "file"
        raise UsageError(f"{folder / path}: found a {what} that is not the dataset's; move it away")
    refuse_foreign(folder / manifest.CARD)
    refuse_edits(folder, listed, "the new dataset")
    for name in known:
        if (folder / name).is_dir():
            raise UsageError(f"{folder / name}: found a folder in the place of a file; move it away")


def begin(root: Path, experiment: Experiment, overwrite: bool) -> None:
    """Make the run's folder, remove files of other experiments, and note the experiment."""
    mine = root / EXPERIMENT
    if (
        not mine.is_file()
        or (overwrite and root.name != manifest.NEXT)
        or mine.read_bytes() != as_yaml(experiment)
    ):
        discard(root)
    if root.name == manifest.NEXT:
        staging.make(root)
    root.mkdir(exist_ok=True)
    remove_temporaries(root)
    if not mine.is_file():
        write(root, EXPERIMENT, as_yaml(experiment))
    for path, data in _weights(experiment).items():
        create_or_compare(root, path, data)


def _weights(experiment: Experiment) -> dict[str, bytes]:
    """The weights of an experiment by the paths at which they lie beside its YAML file, for `finalize`."""
    return {f"{receipt.FOLDER}/{name}": data for name, data in DatasetSpec.of(experiment).weights.items()}


def begin_range(root: Path, experiment: Experiment, shards: Sequence[Shard]) -> None:
    """As `begin`, for some shards, while others may be written. Removes only temporary files of these shards.

    Raises UsageError if another experiment was begun here meanwhile.
    """
    sweep_shards(root, shards)
    if not create_or_compare(root, EXPERIMENT, as_yaml(experiment)):
        raise UsageError(f"{root}: holds an unfinished run of another experiment; choose another --out")
    for path, data in _weights(experiment).items():
        create_or_compare(root, path, data)


def refuse_moved(root: Path, run: str) -> None:
    """Raise IbdataError if the folder is no longer that of the run: files could be put into another run's."""
    try:
        same = _hashed((root / EXPERIMENT).read_bytes()) == run
    except OSError:
        same = False
    if not same:
        raise IbdataError(
            f"{root}: no longer the folder in which this run began; it was moved or removed meanwhile"
        )


def _is_lost(root: Path) -> bool:
    """Whether a folder belongs to another run now, so that nothing in it may be removed."""
    return lock.is_lost(root.parent if root.name == manifest.NEXT else root)


def sweep_shards(root: Path, shards: Iterable[Shard]) -> None:
    """Remove the temporary files of killed writers of these shards."""
    if _is_lost(root):
        return
    remove_temporaries(
        root, {Path(path).name for shard in shards for path in (shard.stem, receipt.path_of(shard))}
    )


def forget(root: Path, shards: Iterable[Shard]) -> None:
    """Remove all files of shards that are to be written, even complete ones that have no receipt."""
    if _is_lost(root):
        return
    shards = list(shards)
    sweep_shards(root, shards)
    numbers = {Path(shard.stem).name for shard in shards}
    for path in (root / "data").glob("part-*.parquet"):
        if staging.is_ours(path) and path.name.rpartition("-")[0] in numbers:
            path.unlink(missing_ok=True)


def settle_data(root: Path, written: Iterable[WrittenShard]) -> None:
    """Leave in `data` what a run has written, before its manifest lists it.

    Files of shards that another writer left go. Raises UsageError if something else is there that a reader
    would take, and IbdataError if the folder belongs to another run now.
    """
    if _is_lost(root):
        raise IbdataError(
            f"{root}: its lock was removed, and another run may be writing; run again with --resume"
        )
    for path in (root / stranger for stranger in strangers(root, {w.entry.path for w in written})):
        if not staging.is_ours(path):
            raise UsageError(
                f"{path}: found something that is not the dataset's; move it away, then --resume"
            )
        path.unlink(missing_ok=True)


def end(root: Path) -> None:
    """Remove the receipts, which the manifest replaces."""
    empty_run(root / receipt.FOLDER)
    for left in root.glob(f"{RANGE_LOCK}*"):  # of ranges that were killed
        if RANGE_LOCKS.fullmatch(left.name) and not left.is_dir():
            left.unlink(missing_ok=True)


def abandon(root: Path) -> None:
    """Clean up after a failure. If shards have receipts, keep them for --resume; otherwise keep nothing."""
    if _is_lost(root):
        return
    remove_temporaries(root)
    if not list((root / receipt.FOLDER).glob("*.receipt")):
        discard(root)
