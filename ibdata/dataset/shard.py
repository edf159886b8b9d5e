"""One shard: simulate, write, and say what was written."""

from __future__ import annotations

import hashlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow.parquet as pq

from ibdata.columns import Table, columns
from ibdata.dataset.digest import episode_digests
from ibdata.dataset.files import FileEntry, HashingFile, committed
from ibdata.dataset.schema import ROW_GROUP_ROWS, arrow_schema, arrow_table, digest_runs, writer_options
from ibdata.dataset.statistics import Floats, Moments, moments, sample_stride, sums
from ibdata.errors import IbdataError
from ibdata.experiment import Experiment
from ibdata.experiment.plan import Shard
from ibdata.experiment.recipe import Recipe
from ibdata.rollout import Columns, rollout


class Content(NamedTuple):
    """What is in a shard, whatever file holds it."""

    digests: list[bytes]  # of the episodes
    returns: Floats  # of the episodes, undiscounted
    moments: Moments  # of the float columns
    sample: Table  # of the float columns, for quantiles
    clipped: int
    labelled: dict[str, tuple[Moments, Table]]  # moments and sample of each split that is not whole files


# The content of a shard that nobody has read.
UNREAD = Content([], np.empty(0), Moments(0, *(np.empty(0) for _ in range(4))), np.empty((0, 0)), 0, {})


class Written(NamedTuple):
    """A shard that is on the disk."""

    shard: Shard
    entry: FileEntry
    content: Content


def write_shard(recipe: Recipe, shard: Shard, folder: Path, floats: Columns | None = None) -> Written:
    """Commit a shard to its file: simulated, or with these columns."""
    experiment = recipe.of_shard(shard)
    if floats is None:
        floats = rollout(experiment, shard.first, shard.stop)
    # Hashing and encoding both let go of Python's lock: side by side they take less time.
    with ThreadPoolExecutor(1) as pool:
        content = pool.submit(describe, recipe, shard, floats)
        with committed(folder, shard.file) as file:
            encode(experiment, shard, floats, file)
    entry = FileEntry(shard.file, file.size, file.sha256())
    return Written(shard, entry, content.result())


def encode(experiment: Experiment, shard: Shard, floats: Columns, file: HashingFile) -> None:
    """Write a shard as Parquet."""
    described = columns(experiment)
    with pq.ParquetWriter(file, arrow_schema(described), **writer_options(described)) as writer:
        writer.write_table(arrow_table(experiment, shard, floats), row_group_size=ROW_GROUP_ROWS)


def content_of(digests: list[bytes]) -> str:
    """The hex digest of a shard's content, from those of its episodes."""
    return hashlib.sha256(b"".join(digests)).hexdigest()


def describe(recipe: Recipe, shard: Shard, floats: Columns) -> Content:
    """Digests, returns and statistics of a shard; IbdataError where a value is not finite."""
    experiment = recipe.of_shard(shard)
    parts = moments(floats.table)
    finite = np.isfinite(parts.squares)
    finite[floats.names.index("action_log_prob")] = True  # a custom policy may not know its density
    if not finite.all():
        name = floats.names[int(np.argmin(finite))]
        raise IbdataError(f"{shard.file}: {name}: found a value that is not finite, expected finite numbers")
    episodes = shard.stop - shard.first
    return Content(
        episode_digests(digest_runs(experiment, shard, floats), [experiment.steps] * episodes),
        sums(floats.table[floats.names.index("reward")], experiment.steps),
        parts,
        _sample(floats.table, experiment),
        floats.clipped,
        _labelled(recipe, shard, floats.table),
    )


def _sample(table: Table, experiment: Experiment) -> Table:
    return np.ascontiguousarray(table[:, :: sample_stride(table.shape[1], experiment.rows)])


def _labelled(recipe: Recipe, shard: Shard, table: Table) -> dict[str, tuple[Moments, Table]]:
    """Moments and sample of the rows of each later split."""
    experiment = recipe.of_shard(shard)
    parts: dict[str, list[Table]] = {}
    for first, stop, names in recipe.runs(shard) if recipe.later else ():
        rows = slice((first - shard.first) * experiment.steps, (stop - shard.first) * experiment.steps)
        for name in recipe.later.keys() & set(names):
            parts.setdefault(name, []).append(table[:, rows])
    joined = {name: np.concatenate(tables, axis=1) for name, tables in parts.items()}
    return {name: (moments(part), _sample(part, experiment)) for name, part in joined.items()}
