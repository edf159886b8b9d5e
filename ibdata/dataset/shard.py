"""One shard: simulate, write, and say what was written."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
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
from ibdata.rollout import Columns, filling


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
    """Commit a shard to its file: simulated, or with these columns.

    What is there is encoded and hashed while the rest is simulated; all three let go of Python's lock.
    """
    experiment = recipe.of_shard(shard)
    total = (shard.stop - shard.first) * experiment.steps
    parts = filling(experiment, shard.first, shard.stop) if floats is None else iter([(floats, total)])
    encoded: list[Future[None]] = []
    hashed: list[Future[list[bytes]]] = []
    rows = 0
    with committed(folder, shard.file) as file, _writer(experiment, file) as writer, _threads() as threads:
        for made, ready in parts:
            if rows == 0:
                table = arrow_table(experiment, shard, made)  # without a copy: it fills as the columns do
            start, stop = (n if n == total else n - n % ROW_GROUP_ROWS for n in (rows, ready))
            if start < stop:
                part = table.slice(start, stop - start)
                encoded.append(threads[0].submit(writer.write_table, part, row_group_size=ROW_GROUP_ROWS))
            hashed.append(threads[1].submit(_digests, experiment, shard, made, rows, ready))
            rows = ready
        digests = [digest for future in hashed for digest in future.result()]
        content = describe(recipe, shard, made, digests)
        for future in encoded:
            future.result()
    return Written(shard, FileEntry(shard.file, file.size, file.sha256()), content)


def _writer(experiment: Experiment, file: HashingFile) -> pq.ParquetWriter:
    described = columns(experiment)
    return pq.ParquetWriter(file, arrow_schema(described), **writer_options(described))


@contextmanager
def _threads() -> Iterator[tuple[ThreadPoolExecutor, ThreadPoolExecutor]]:
    """One thread to encode in order, one to hash."""
    with ThreadPoolExecutor(1) as encoder, ThreadPoolExecutor(1) as hasher:
        yield encoder, hasher


def encode(experiment: Experiment, shard: Shard, floats: Columns, file: HashingFile) -> None:
    """Write a shard as Parquet."""
    with _writer(experiment, file) as writer:
        writer.write_table(arrow_table(experiment, shard, floats), row_group_size=ROW_GROUP_ROWS)


def _digests(experiment: Experiment, shard: Shard, floats: Columns, start: int, stop: int) -> list[bytes]:
    """The digests of the episodes in rows start … stop - 1 of a shard."""
    steps = experiment.steps
    part = shard._replace(first=shard.first + start // steps, stop=shard.first + stop // steps)
    own = floats._replace(table=floats.table[:, start:stop])
    return episode_digests(digest_runs(experiment, part, own), [steps] * (part.stop - part.first))


def content_of(digests: list[bytes]) -> str:
    """The hex digest of a shard's content, from those of its episodes."""
    return hashlib.sha256(b"".join(digests)).hexdigest()


def describe(recipe: Recipe, shard: Shard, floats: Columns, digests: list[bytes] | None = None) -> Content:
    """Digests, if they are not known, returns and statistics of a shard.

    Raises IbdataError where a value is not finite.
    """
    experiment = recipe.of_shard(shard)
    parts = moments(floats.table)
    finite = np.isfinite(parts.squares)
    finite[floats.names.index("action_log_prob")] = True  # a custom policy may not know its density
    if not finite.all():
        name = floats.names[int(np.argmin(finite))]
        raise IbdataError(f"{shard.file}: {name}: found a value that is not finite, expected finite numbers")
    return Content(
        _digests(experiment, shard, floats, 0, floats.table.shape[1]) if digests is None else digests,
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
