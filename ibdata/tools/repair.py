"""Repairing a dataset: broken shards are made again and compared with the manifest's digests."""

from __future__ import annotations

import os
from pathlib import Path

from ibdata._numerics.arguments import public
from ibdata._system.files import FileEntry, keep_access, remove, rename, sync_folder, write
from ibdata._system.part import DATASET, locked_part, resolved, tidy
from ibdata._system.progress import Progress
from ibdata._system.runs import FolderRun
from ibdata._system.signals import check
from ibdata._system.storage import local
from ibdata.dataset import manifest
from ibdata.dataset.stored import Stored
from ibdata.errors import DatasetError, UsageError, notice
from ibdata.generation import metadata
from ibdata.generation.card import card_of
from ibdata.generation.finish import (
    NEED_CONTENT,
    encoded,
    metadata_contents,
    refuse_other_plan,
    rewritten_manifest,
)
from ibdata.generation.process import process_for
from ibdata.generation.record import warm_up_again
from ibdata.generation.shard import WrittenShard, all_written
from ibdata.generation.workers import make_shards, refuse_workers
from ibdata.plan.consent import require_consent
from ibdata.plan.dataset_spec import DatasetSpec, Shard, declared_spec, spec_in
from ibdata.tools.checks import check_shard, splits_problems
from ibdata.tools.validate import Hashing, card_problems, unlisted_files, validate


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
    place = local(folder)
    tidy(place)
    stored = _stored(place)
    for problem in unlisted_files(stored):
        raise UsageError(f"{place / problem.path}: {problem.message}, then repair")
    broken = _broken(stored)
    _refuse_lost_weights(stored, broken)
    spec = declared_spec(stored)
    refuse_other_plan(spec, stored.manifest)
    if not broken:
        return []
    with locked_part(resolved(place), place) as part:
        stored.refuse_replaced()
        missing = [path for path in broken if not os.path.lexists(part.target / path)]
        whole, wrong = _checked_shards(stored, spec, broken)
        if wrong:
            require_consent(spec, stored.storage.path, allow_code, again=True)
            whole += _made_again(part.folder / "repair", stored, spec, wrong, workers)
        entries = _repaired(stored, spec, broken, whole)
        for path in missing:
            keep_access(part.target / manifest.PATH, part.target / path)
        old = stored.manifest.entries()
        if entries != old:
            write(part.target, manifest.PATH, rewritten_manifest(stored.manifest, entries))
        if manifest.CARD in broken:
            repaired = Stored.open(place)
            write(part.target, manifest.CARD, card_of(repaired, spec_in(repaired)))
        for problem in validate(place):  # so that nothing else is called repaired
            again = f"found after all was made again: {problem.message}"
            raise DatasetError(f"{place / problem.path}: {again}; make the dataset again with generate")
    return broken + [path for path in entries if path not in broken and entries[path] != old[path]]


def _stored(place: Path) -> Stored:
    try:
        return Stored.open(place)
    except DatasetError as error:
        again = f"ibdata generate --config {place / manifest.EXPERIMENT} --out NEW makes the dataset again"
        known = os.path.isfile(place / manifest.EXPERIMENT)
        raise DatasetError(f"{error}; {again}" if known else str(error)) from None


def _broken(stored: Stored) -> list[str]:
    """The paths of the files that are missing, or not as the manifest lists them."""
    broken: list[str] = []
    with Hashing(stored) as files:
        for path in stored.manifest.entries():
            check()
            if not files.is_whole(path):
                broken.append(path)
    if any(splits_problems(stored)):
        broken.append(manifest.SPLITS)
    if any(card_problems(stored)):
        broken.append(manifest.CARD)
    return broken


def _refuse_lost_weights(stored: Stored, broken: list[str]) -> None:
    for path in broken:
        if manifest.WEIGHTS.fullmatch(path):
            raise DatasetError(
                f"{stored.storage.path / path}: missing or damaged, and weights cannot be made again; copy "
                f"the file with the SHA-256 {stored.manifest.entries()[path].sha256} there, then repair"
            )


def _made_again(
    root: Path, stored: Stored, spec: DatasetSpec, shards: list[Shard], workers: int | None
) -> list[WrittenShard]:
    """Make shards again in a folder, then put them in the place of the broken ones.

    Raises DatasetError if one has another content than the manifest lists; then no shard is changed.
    """
    folder, run = stored.storage.path, FolderRun(root)
    remove(root)  # that of a repair that was killed
    (root / DATASET).mkdir(parents=True)
    try:
        with process_for(spec) as process:
            process.call(warm_up_again)
            for _ in make_shards(process, shards, run, workers, Progress().reach):
                pass
        written = all_written(run, shards, folder, "no shard was changed; repair again")
        for shard, _, summary in written:
            entry = stored.shard(shard.number)
            if summary.content != entry.content:
                raise DatasetError(
                    f"{folder / entry.path}: found other content when made again, expected the content that "
                    "the manifest lists; no shard was changed"
                )
        return [_in_place(made, root / DATASET, stored) for made in written]
    finally:
        remove(root)


def _in_place(made: WrittenShard, folder: Path, stored: Stored) -> WrittenShard:
    """Put the file of a shard in the place of the broken one, whose mode and group it gets."""
    listed = stored.shard(made.shard.number).path
    path = stored.storage.path / listed
    path.parent.mkdir(exist_ok=True)
    keep_access(path, folder / made.entry.path)
    rename(folder / made.entry.path, path)
    sync_folder(path.parent)
    return made._replace(entry=made.entry._replace(path=listed))


def _repaired(
    stored: Stored, spec: DatasetSpec, broken: list[str], whole: list[WrittenShard]
) -> dict[str, FileEntry]:
    """Repair the broken metadata; return the entries that the manifest is to have.

    Of the shards, those are given that were read or made again.
    """
    folder, listed = stored.storage.path, stored.manifest
    whole = sorted(whole, key=lambda written: written.shard.number)
    entries = listed.entries() | {written.entry.path: written.entry for written in whole}
    for path, make in metadata_contents(spec, whole, entries, listed.content_root).items():
        if path in broken or (path == manifest.CROISSANT and entries != listed.entries()):
            entries[path] = write(folder, path, encoded(make()))
    if manifest.SPLITS in broken:
        write(folder, manifest.SPLITS, metadata.splits_file(spec))
        notice(f"{folder}: splits that were made later, if there were any, are lost; make them again")
    return entries


def _checked_shards(
    stored: Stored, spec: DatasetSpec, broken: list[str]
) -> tuple[list[WrittenShard], list[Shard]]:
    """The shards that have the content which the manifest lists, and those that have another.

    Their rows are read only where that is needed; a shard that need not be read is in neither list.
    """
    are_read, entries = not set(broken).isdisjoint(NEED_CONTENT), stored.manifest.entries()
    whole, wrong = list[WrittenShard](), list[Shard]()
    for shard, listed in zip(spec.shards, stored.manifest.shards, strict=True):
        if are_read or listed.path in broken:
            summary, _ = check_shard(spec, shard, stored.storage, listed.path)
            if summary is None or summary.content != listed.content:
                wrong.append(shard)
            else:
                entry = stored.storage.entry(listed.path) or entries[listed.path]
                whole.append(WrittenShard(shard, entry, summary))
            check()
    return whole, wrong
