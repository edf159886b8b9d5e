"""Repairing a dataset: broken shards are made again and compared with the manifest's digests."""

from __future__ import annotations

import os
from pathlib import Path

from ibdata.arguments import public
from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.dataset.stored import Stored
from ibdata.errors import DatasetError, UsageError, notice
from ibdata.experiment.code import require_consent
from ibdata.experiment.dataset_spec import DatasetSpec, declared_spec
from ibdata.experiment.plan import Shard
from ibdata.generation.process import process_for
from ibdata.generation.record import known_answer, warm_up
from ibdata.generation.workers import refuse_workers, run
from ibdata.system.files import FileEntry, keep_access, remove, sync_folder, write
from ibdata.system.part import Part, locked_part, resolved
from ibdata.system.progress import Progress
from ibdata.system.signals import check
from ibdata.system.storage import existing, local, storage
from ibdata.validation.checks import check_shard, splits_problems
from ibdata.validation.validate import unlisted_files, validate
from ibdata.writing import metadata
from ibdata.writing.finish import NEED_CONTENT, metadata_files, refuse_other_plan, rewritten_manifest
from ibdata.writing.shard import DATASET, UNREAD, WrittenShard, all_written, content_of

REPAIR = "repair"  # the folder of a part in which shards are made again


@public
def repair(folder: str | os.PathLike[str], workers: int | None = None, allow_code: bool = False) -> list[str]:
    """Make the broken and missing files of a dataset again, and only them.

    A shard is replaced only by one with the content that the manifest lists. If pyarrow writes other bytes
    than the version that made the dataset, the manifest gets the new hashes.

    Args:
        folder: The folder of the dataset.
        workers: How many processes to use; by default chosen by the work.
        allow_code: Allow custom policies, which run arbitrary Python code, to make shards again. They give
            the same bits only in the same environment.

    Returns:
        The paths of the files that were made again, or whose entries in the manifest were mended.

    Raises:
        DatasetError: There is no manifest, weights are lost, a shard that was made again differs, or
            a problem is left that `validate` finds.
        UsageError: There are files that are not the dataset's, or custom policies that are not allowed.
    """
    refuse_workers(workers)
    place = local(existing(folder))
    stored = _stored(place)
    for problem in unlisted_files(stored):
        raise UsageError(f"{place / problem.path}: {problem.message}, then repair")
    spec = _spec(stored)
    refuse_other_plan(spec, stored.manifest)
    broken = _broken(stored)
    if not broken:
        return []
    with locked_part(resolved(place), place) as part:
        stored.refuse_replaced()
        missing = [path for path in broken if not os.path.lexists(part.target / path)]
        try:
            entries = _repaired(part, spec, stored.manifest, broken, workers, allow_code)
            for path in missing:
                keep_access(part.target / manifest.PATH, part.target / path)
        finally:
            remove(part.folder / REPAIR)
        if entries != stored.manifest.entries():
            write(part.target, manifest.PATH, rewritten_manifest(stored.manifest, entries))
        _refuse_broken(place)
    return broken


def _refuse_broken(place: Path) -> None:
    """Raise DatasetError where `validate` still finds a problem, so that nothing else is called repaired."""
    for problem in validate(place):
        again = f"found after all was made again: {problem.message}"
        raise DatasetError(f"{place / problem.path}: {again}; make the dataset again with generate")


def _stored(place: Path) -> Stored:
    try:
        return Stored.open(place)
    except DatasetError as error:
        again = f"ibdata generate --config {place / manifest.EXPERIMENT} --out NEW makes the dataset again"
        known = os.path.isfile(place / manifest.EXPERIMENT)
        raise DatasetError(f"{error}; {again}" if known else str(error)) from None


def _broken(stored: Stored) -> list[str]:
    """The paths of the files that are missing, or not as the manifest lists them."""
    entries = stored.manifest.entries()
    broken = [path for path, entry in entries.items() if _entry(stored.storage.path, path) != entry]
    if any(splits_problems(stored)):
        broken.append(manifest.SPLITS)
    return broken


def _entry(folder: Path, path: str) -> FileEntry | None:
    check()
    return storage(folder).entry(path)


def _spec(stored: Stored) -> DatasetSpec:
    folder, entries = stored.storage.path, stored.manifest.entries()
    for path in entries:
        if manifest.WEIGHTS.fullmatch(path) and _entry(folder, path) != entries[path]:
            raise DatasetError(
                f"{folder / path}: missing or damaged, and weights cannot be made again; copy the file with "
                f"the SHA-256 {entries[path].sha256} there, then repair"
            )
    return declared_spec(stored)


def _repaired(
    part: Part, spec: DatasetSpec, listed: Manifest, broken: list[str], workers: int | None, allow_code: bool
) -> dict[str, FileEntry]:
    """Repair the broken files; return the entries that the manifest is to have."""
    folder, entries = part.target, listed.entries()
    written: list[WrittenShard] = []
    wrong: list[Shard] = []
    for shard, one in zip(spec.shards, listed.shards, strict=True):
        content = UNREAD
        if one.path in broken or not set(broken).isdisjoint(NEED_CONTENT):
            found, _ = check_shard(spec, shard, folder, one.path)
            if found is None or content_of(found.digests) != one.content:
                wrong.append(shard)
            else:
                content = found
                entries[one.path] = _entry(folder, one.path) or entries[one.path]
        written.append(WrittenShard(shard, entries[one.path], content))
        check()
    for made in _made_again(part.folder / REPAIR, spec, wrong, listed, workers, allow_code, folder):
        path = listed.shards[made.shard.number].path
        _move(part.folder / REPAIR / DATASET / made.entry.path, folder / path)
        entries[path] = made.entry._replace(path=path)
        written[made.shard.number] = made._replace(entry=entries[path])
    for path, data in metadata_files(broken, spec, written):
        entries[path] = write(folder, path, data)
    if manifest.SPLITS in broken:
        write(folder, manifest.SPLITS, metadata.splits_file(spec))
        notice(f"{folder}: splits that were made later are lost; make them again")
    return entries


def _made_again(
    root: Path,
    spec: DatasetSpec,
    wrong: list[Shard],
    listed: Manifest,
    workers: int | None,
    allow_code: bool,
    folder: Path,
) -> list[WrittenShard]:
    """Make shards in a folder. Raises DatasetError if one has another content than the manifest lists."""
    if not wrong:
        return []
    require_consent(spec, folder, allow_code, again=True)
    remove(root)  # that of a repair that was killed
    root.mkdir()
    (root / DATASET).mkdir()
    with process_for(spec) as process:
        process.call(_warm_up)
        for _ in run(process, wrong, root, workers, Progress().reach):
            pass
    made = all_written(root, wrong, folder, "no shard was changed; repair again")
    for each in made:
        one = listed.shards[each.shard.number]
        if content_of(each.content.digests) != one.content:
            raise DatasetError(
                f"{folder / one.path}: found other content when made again, expected the content that the "
                "manifest lists; no shard was changed"
            )
    return made


def _warm_up(spec: DatasetSpec) -> None:
    for experiment in spec.experiments:
        warm_up(experiment)
    known_answer("episodes made again may differ")


def _move(made: Path, path: Path) -> None:
    """Put a file that was made again in the place of the broken one, whose mode and group it gets."""
    path.parent.mkdir(exist_ok=True)
    keep_access(path, made)
    made.replace(path)
    sync_folder(path.parent)
