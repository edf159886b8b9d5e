"""Datasets out of datasets: the same episodes under other splits or numbers, copied and proven."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from ibdata.columns import layout
from ibdata.dataset import manifest, parquet
from ibdata.dataset.content import describe
from ibdata.dataset.files import FileEntry, write
from ibdata.dataset.finish import documents, finish, renew
from ibdata.dataset.reader import Dataset
from ibdata.dataset.shard import Begun, Written
from ibdata.dataset.threads import Threads
from ibdata.engines import lock, target
from ibdata.engines.generate import made_folder, refusals
from ibdata.engines.signals import check, stoppable
from ibdata.errors import DatasetError, UsageError
from ibdata.experiment.plan import Shard
from ibdata.experiment.recipe import Recipe
from ibdata.rollout import Columns


class Source(NamedTuple):
    """Where the episodes of an experiment are: a dataset, and the number of the first of them in it."""

    dataset: Dataset
    first: int


def sources(dataset: Dataset, recipe: Recipe) -> list[Source]:
    """The source of each experiment of a dataset."""
    counts = [len(e.cells) * e.episodes for e in recipe.experiments]
    return [Source(dataset, sum(counts[:i])) for i in range(len(counts))]


def write_dataset(recipe: Recipe, of: list[Source], out: str | os.PathLike[str]) -> Dataset:
    """Write a recipe's dataset to a new folder, each experiment's episodes from its source.

    Raises UsageError where the folder is not new, DatasetError where what is read is not what the source
    lists; then nothing is left behind. What a killed run left is taken away by the next.
    """
    folder = target.meant(out)
    root = folder / manifest.NEXT
    _refuse(folder)
    lock.refuse_busy(folder)
    with refusals(folder), stoppable(), made_folder(folder), lock.locked(folder):
        _refuse(folder)
        try:
            target.discard(root)
            root.mkdir()
            written = []
            for shard in recipe.shards:
                written.append(_copied(recipe, shard, of[shard.experiment], root))
                check()
            listed = list({id(source.dataset): source.dataset.manifest for source in of}.values())
            code = [each for one in listed for each in one["code"]]
            clipped = sum(one["clipped_actions"] for one in listed)
            finish(recipe, written, root, all(one["reproducible"] for one in listed), code, clipped)
        except BaseException:
            target.discard(root)
            raise
        manifest.promote(folder)
    return Dataset(folder)


def _refuse(folder: Path) -> None:
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise UsageError(f"{folder}: found no folder, expected one or nothing; choose another --out")
    if folder.exists() and any(path.name not in (lock.NAME, manifest.NEXT) for path in folder.iterdir()):
        raise UsageError(f"{folder}: exists already; choose another --out")
    if folder.exists():
        target.refuse_links(folder)


def _copied(recipe: Recipe, shard: Shard, source: Source, root: Path) -> Written:
    """A shard with a source's episodes, which are proven to be those that it lists."""
    with Threads() as threads:
        w = Begun(recipe, shard, root, threads, _columns(recipe, shard, source)).finish()
    _prove(w, source)
    return w


def _columns(recipe: Recipe, shard: Shard, source: Source) -> Columns:
    """The float columns of a shard's episodes, read from whatever files of the source hold them."""
    experiment = recipe.of_shard(shard)
    names = layout(experiment).names
    first, stop = source.first + shard.first, source.first + shard.stop
    parts: list[pa.Table] = []
    for listed in source.dataset.manifest["shards"]:
        low, high = max(first, listed["episodes"][0]), min(stop, listed["episodes"][1])
        if low < high:
            whole = parquet.read(manifest.locate(source.dataset.path, listed["path"]), names)
            start = (low - listed["episodes"][0]) * experiment.steps
            parts.append(whole.slice(start, (high - low) * experiment.steps))
    table = pa.concat_tables(parts)
    if len(table) != (stop - first) * experiment.steps:
        raise _changed(source)
    return Columns(names, np.stack([table[name].to_numpy() for name in names]), 0)


def _prove(w: Written, source: Source) -> None:
    if (
        w.content.digests
        != source.dataset.digests[source.first + w.shard.first : source.first + w.shard.stop]
    ):
        raise _changed(source)


def _changed(source: Source) -> DatasetError:
    path = source.dataset.path
    return DatasetError(f"{path}: found other content than it lists; see ibdata validate {path}")


def relabel(dataset: Dataset, recipe: Recipe) -> Dataset:
    """Give a dataset the later splits of a recipe, in its metadata; its rows are read, and stay.

    A report is taken away, as it tells of the old splits.

    Raises DatasetError where the rows are not what the dataset lists, BusyError where it is being written.
    """
    folder = dataset.path
    lock.refuse_busy(folder)
    target.refuse_links(folder)
    with refusals(folder), stoppable(), lock.locked(folder):
        manifest.settle(folder)
        dataset = Dataset(folder)
        listed = dataset.manifest
        entries = {file["path"]: FileEntry(**file) for file in listed["files"]}
        of = sources(dataset, recipe)
        written = [_read(recipe, shard, of[shard.experiment], entries[shard.file]) for shard in recipe.shards]
        staged = folder / manifest.NEXT
        try:
            target.discard(staged)
            staged.mkdir()
            for path, make in documents(recipe, written, listed["content_root"]).items():
                entries[path] = write(staged, path, make())
            entries.pop(manifest.REPORT, None)  # it tells of the old splits
            renew(folder, listed, entries, splits=recipe.plain()["splits"])
        except BaseException:
            target.discard(staged)
            raise
    return Dataset(folder)


def _read(recipe: Recipe, shard: Shard, source: Source, entry: FileEntry) -> Written:
    """A shard that is there, with its content."""
    w = Written(shard, entry, describe(recipe, shard, _columns(recipe, shard, source)))
    _prove(w, source)
    check()
    return w
