"""Repairing a dataset: broken shards are made again and compared with the manifest's digests."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

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
from ibdata.generation.croissant import croissant
from ibdata.generation.finish import (
    NEED_CONTENT,
    encoded,
    metadata_contents,
    refuse_other_plan,
    rewritten_manifest,
)
from ibdata.generation.process import process_for
from ibdata.generation.record import warm_up_again
from ibdata.generation.shard import WrittenShard, all_written, content_of
from ibdata.generation.workers import make_shards, refuse_workers
from ibdata.plan.consent import require_consent
from ibdata.plan.dataset_spec import DatasetSpec, Shard, declared_spec, spec_in
from ibdata.tools.checks import check_shard, splits_problems
from ibdata.tools.validate import Hashing, card_problems, unlisted_files, validate

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
        remaking = Remaking(part.folder / REPAIR, spec, workers, allow_code)
        try:
            entries = _repaired(stored, spec, broken, remaking)
            for path in missing:
                keep_access(part.target / manifest.PATH, part.target / path)
        finally:
            remove(remaking.root)
        old = stored.manifest.entries()
        if entries != old:
            write(part.target, manifest.PATH, rewritten_manifest(stored.manifest, entries))
        if manifest.CARD in broken:
            repaired = Stored.open(place)
            write(part.target, manifest.CARD, card_of(repaired, spec_in(repaired)))
        _refuse_broken(place)
    return broken + [path for path in entries if path not in broken and entries[path] != old[path]]


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


class Remaking(NamedTuple):
    """How shards are made again: in a folder of their own."""

    root: Path
    spec: DatasetSpec
    workers: int | None
    allow_code: bool

    def make(self, shards: list[Shard], stored: Stored) -> list[WrittenShard]:
        """Make shards again. Raises DatasetError if one has another content than the manifest lists."""
        if not shards:
            return []
        folder = stored.storage.path
        require_consent(self.spec, folder, self.allow_code, again=True)
        remove(self.root)  # that of a repair that was killed
        self.root.mkdir()
        (self.root / DATASET).mkdir()
        with process_for(self.spec) as process:
            process.call(warm_up_again)
            for _ in make_shards(process, shards, FolderRun(self.root), self.workers, Progress().reach):
                pass
        written = all_written(FolderRun(self.root), shards, folder, "no shard was changed; repair again")
        for shard in written:
            entry = stored.shard(shard.shard.number)
            if content_of(shard.content.digests) != entry.content:
                raise DatasetError(
                    f"{folder / entry.path}: found other content when made again, expected the content that "
                    "the manifest lists; no shard was changed"
                )
        return written


def _repaired(
    stored: Stored, spec: DatasetSpec, broken: list[str], remaking: Remaking
) -> dict[str, FileEntry]:
    """Repair the broken files; return the entries that the manifest is to have."""
    folder, entries = stored.storage.path, stored.manifest.entries()
    whole, wrong = _checked_shards(stored, spec, broken)
    for remade in remaking.make(wrong, stored):
        path = stored.shard(remade.shard.number).path
        _move(remaking.root / DATASET / remade.entry.path, folder / path)
        whole.append(remade._replace(entry=remade.entry._replace(path=path)))
    whole.sort(key=lambda written: written.shard.number)
    entries |= {written.entry.path: written.entry for written in whole}
    for path, make in metadata_contents(spec, whole).items():
        if path in broken:
            entries[path] = write(folder, path, encoded(make()))
    if manifest.CROISSANT in broken or entries != stored.manifest.entries():
        paths = [shard.path for shard in stored.manifest.shards]
        described = croissant(spec, paths, entries.values(), stored.manifest.content_root)
        entries[manifest.CROISSANT] = write(folder, manifest.CROISSANT, encoded(described))
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
            content, _ = check_shard(spec, shard, stored.storage, listed.path)
            if content is None or content_of(content.digests) != listed.content:
                wrong.append(shard)
            else:
                entry = stored.storage.entry(listed.path) or entries[listed.path]
                whole.append(WrittenShard(shard, entry, content))
            check()
    return whole, wrong


def _move(file: Path, path: Path) -> None:
    """Put a file that was made again in the place of the broken one, whose mode and group it gets."""
    path.parent.mkdir(exist_ok=True)
    keep_access(path, file)
    rename(file, path)
    sync_folder(path.parent)
