"""Repairing a dataset: what is damaged or missing is made again, and the content root proves it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ibdata.columns import columns
from ibdata.dataset import manifest, parquet
from ibdata.dataset.content import UNREAD, content_of, describe
from ibdata.dataset.digest import episode_digests, table_runs
from ibdata.dataset.files import FileEntry, file_sha256, write
from ibdata.dataset.finish import documents, finish, renew
from ibdata.dataset.frame import frame_of
from ibdata.dataset.shard import Written
from ibdata.dataset.validation import check_files
from ibdata.engines import local, target
from ibdata.engines.choice import worker_count
from ibdata.engines.code import provenance, recipe_of, refuse_code
from ibdata.engines.generate import refusals
from ibdata.engines.lock import locked, refuse_busy
from ibdata.engines.signals import stoppable
from ibdata.engines.warmup import warm_up
from ibdata.errors import DatasetError
from ibdata.experiment import Experiment, load
from ibdata.experiment.plan import Shard
from ibdata.experiment.recipe import Recipe
from ibdata.rollout import rollout

NEEDS_CONTENT = {"meta/episodes.parquet", "meta/stats.json"}


def repair(folder: str | os.PathLike[str], workers: int | None = None, allow_code: bool = False) -> list[str]:
    """Make the damaged and missing files of a dataset again; their paths.

    Only those are touched, and only if what was made again has the content that the manifest lists. A
    damaged manifest is made again from meta/experiment.yaml, if the shards prove that it is theirs. Where
    pyarrow writes other bytes than the version that made the dataset, the manifest gets the new hashes.
    A damaged report.html is taken away instead: `ibdata card` draws it again.
    allow_code lets custom policies run, which promise the same bits in the same environment only.

    Raises DatasetError where there is no dataset, or what was made again is not what was there.
    """
    path, processes = Path(folder), worker_count(workers)
    if not os.path.isdir(path / "meta"):  # False where the system refuses the name
        raise DatasetError(f"{path}: no dataset here: meta is missing")
    refuse_busy(path)
    target.refuse_links(path)
    with stoppable(), refusals(path), locked(path), _nothing_left(path):
        manifest.settle(path)
        try:
            listed = manifest.read(path)
        except manifest.NewerError:
            raise
        except DatasetError:
            return _rebuild(path, processes, allow_code)
        return _mend(path, listed, processes, allow_code)


@contextmanager
def _nothing_left(folder: Path) -> Iterator[None]:
    """Take away what a repair that failed has made."""
    try:
        yield
    except BaseException:
        target.discard(folder / manifest.NEXT)
        raise


def _mend(folder: Path, listed: dict[str, Any], workers: int, allow_code: bool) -> list[str]:
    """Make again the listed files that are damaged."""
    entries = {file["path"]: FileEntry(**file) for file in listed["files"]}
    damaged = [problem.path for problem in check_files(folder, listed) if problem.path in entries]
    if not damaged:
        return []
    recipe = recipe_of(folder, listed, allow_code)
    for experiment in recipe.experiments:
        warm_up(experiment)
    shards = recipe.shards
    made = _made_again(recipe, [s for s in shards if s.file in damaged], folder, workers)
    for shard, was in zip(shards, listed["shards"], strict=True):
        w = made.get(shard.number)
        if w is not None and content_of(w.content.digests) != was["content"]:
            raise DatasetError(
                f"{folder / shard.file}: found other content when made again, expected what the manifest "
                "lists; nothing was changed"
            )
        if w is not None:
            entries[shard.file] = w.entry
    lost = [path for path in damaged if not path.startswith("data/")]
    simulate = bool(NEEDS_CONTENT & set(lost))
    written = [
        made.get(shard.number) or _known(recipe, shard, entries[shard.file], simulate) for shard in shards
    ]
    for path, make in documents(recipe, written, listed["content_root"]).items():
        if path in lost:
            entries[path] = write(folder / manifest.NEXT, path, make())
    if manifest.REPORT in damaged:
        del entries[manifest.REPORT]  # `ibdata card` makes it again; here nothing can draw
    renew(folder, listed, entries)
    return damaged


def _rebuild(folder: Path, workers: int, allow_code: bool) -> list[str]:
    """Make the manifest again, and the shards that do not have the experiment's content."""
    recipe = _told(folder)
    refuse_code(recipe, folder, allow_code)
    reproducible = all([warm_up(experiment) for experiment in recipe.experiments])
    whole: list[Written] = []
    wrong: list[Shard] = []
    for shard in recipe.shards:
        experiment = recipe.of_shard(shard)
        content = describe(recipe, shard, rollout(experiment, shard.first, shard.stop))
        path = folder / shard.file
        if _digests_on_disk(path, experiment, shard) == content.digests:
            entry = FileEntry(shard.file, path.stat().st_size, file_sha256(path) or "")
            whole.append(Written(shard, entry, content))
        else:
            wrong.append(shard)
    if not whole:
        raise DatasetError(
            f"{folder}: found no shard with the content of meta/experiment.yaml, expected at least one to "
            "prove that it is the dataset's; nothing was changed"
        )
    made = _made_again(recipe, wrong, folder, workers)
    everything = [*whole, *made.values()]
    finish(recipe, everything, folder / manifest.NEXT, reproducible, provenance(recipe))
    manifest.promote(folder)
    (folder / manifest.REPORT).unlink(missing_ok=True)  # it may tell of splits that are lost
    return [manifest.PATH, *(shard.file for shard in wrong)]


def _told(folder: Path) -> Recipe:
    """What a dataset without a manifest is made of, as meta/experiment*.yaml say; later splits are lost."""
    several = sorted((folder / "meta").glob("experiment-*.yaml"))
    experiments = tuple(load(path) for path in several or [folder / manifest.EXPERIMENT])
    return Recipe(experiments[0].name, experiments)


def _made_again(recipe: Recipe, shards: list[Shard], folder: Path, workers: int) -> dict[int, Written]:
    """The shards, written under `.next`, by number."""
    root = folder / manifest.NEXT
    target.discard(root)
    root.mkdir()
    identity = target.identity(recipe.experiments[0])
    made = {w.shard.number: w for w in local.run(recipe, shards, root, identity, workers)}
    target.end(root)
    return made


def _known(recipe: Recipe, shard: Shard, entry: FileEntry, simulate: bool) -> Written:
    """A shard whose file is whole, with its content where that is needed."""
    if not simulate:
        return Written(shard, entry, UNREAD)
    floats = rollout(recipe.of_shard(shard), shard.first, shard.stop)
    return Written(shard, entry, describe(recipe, shard, floats))


def _digests_on_disk(path: Path, experiment: Experiment, shard: Shard) -> list[bytes] | None:
    """The digests of the episodes in a shard's file; None where it is not readable as such."""
    count = shard.stop - shard.first
    try:
        table = parquet.read(path)
        described = [column._asdict() for column in columns(experiment)]
        firsts = list(range(0, count * experiment.steps, experiment.steps))
        return episode_digests(
            table_runs(frame_of(table, described), table, firsts), [experiment.steps] * count
        )
    except (DatasetError, ValueError, KeyError, IndexError):
        return None
