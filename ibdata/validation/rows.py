"""Check the rows of a shard against every rule, part by part, and summarize them on the way."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ibdata.dataset import parquet
from ibdata.errors import DatasetError
from ibdata.experiment import Experiment
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.simulation.rollout import Columns
from ibdata.simulation.variables import Column, columns
from ibdata.validation.rules import RULES, Broken, Problem, Rows, nulls
from ibdata.validation.stored import BATCH_ROWS, float_columns, stored_parts
from ibdata.writing.statistics import Moments
from ibdata.writing.summary import ShardSummarizer, ShardSummary


def check_shard(
    spec: DatasetSpec, shard: Shard, path: Path, listed: str
) -> tuple[ShardSummary | None, list[Problem]]:
    """Check the rows of a shard.

    Args:
        spec: What the dataset is made of.
        shard: The shard.
        path: Its file.
        listed: The path under which the manifest lists it.

    Returns:
        The summary of the rows, or None where they break a rule or cannot be read; and the problems.
    """
    experiment, account, found = spec.of_shard(shard), ShardSummarizer(spec, shard), _Found(listed)
    try:
        schema, rows = parquet.described(path)
        expected = (shard.stop - shard.first) * experiment.steps
        if wrong := _schema(schema, columns(experiment)):
            return None, [Problem(listed, None, "schema", wrong)]
        if rows != expected:
            message = f"found {rows}, expected {expected} rows of whole episodes"
            return None, [Problem(listed, None, "rows", message)]
        batches = parquet.batches(path, None, BATCH_ROWS)
        with ThreadPoolExecutor(1) as describing:  # it releases the interpreter's lock
            for row, own in _described(spec, shard, batches, account, describing, found):
                for name, rule in RULES.items():
                    found.add(name, row, rule(own))
    except DatasetError as error:
        return None, [Problem.of(error, listed, path, "parquet")]
    problems = found.problems()
    return (None if problems else account.content()), problems


class _Found:
    """The broken rules of a shard. Parts that break the same rule in the same column are one problem."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._broken: dict[tuple[str, str], Broken] = {}

    def add(self, rule: str, row: int, broken: Iterable[Broken]) -> None:
        """Add the rules that a part breaks whose first row is `row` of the shard."""
        for each in broken:
            key = (rule, each.message.partition(":")[0])
            first = self._broken.get(key, Broken(row + each.row, each.message, 0))
            self._broken[key] = first._replace(rows=first.rows + each.rows)

    def problems(self) -> list[Problem]:
        """The problems, rule by rule."""
        return [
            Problem(self._path, row, rule, message + (f" ({count} such rows)" if count > 1 else ""))
            for (rule, _), (row, message, count) in self._broken.items()
        ]


def _described(
    spec: DatasetSpec,
    shard: Shard,
    batches: Iterable[pa.RecordBatch],
    account: ShardSummarizer,
    describing: ThreadPoolExecutor,
    found: _Found,
) -> Iterator[tuple[int, Rows]]:
    """The parts of a shard, each with its first row; the next is read while one is summarized in a thread."""
    experiment, before = spec.of_shard(shard), None
    for part, table in stored_parts(spec, shard, batches):
        row = (part.first - shard.first) * experiment.steps
        missing = list(nulls(table))
        found.add("nulls", row, missing)
        if missing:
            continue
        floats = float_columns(experiment, table)
        after = row, part, table, floats, describing.submit(account.add, part, floats)
        if before:
            yield before[0], _rows(experiment, *before[1:])
        before = after
    if before:
        yield before[0], _rows(experiment, *before[1:])


def _rows(
    experiment: Experiment, part: Shard, table: pa.Table, floats: Columns, described: Future[Moments]
) -> Rows:
    whole = described.result()
    known = dict(zip(floats.names, floats.table, strict=True))
    for name in ("episode", "step", "terminated", "truncated"):
        known[name] = table[name].to_numpy()
    known["policy"] = _labels(table["policy"], experiment.labels)
    ranges = {
        name: (float(whole.low[i]), float(whole.high[i]))
        for i, name in enumerate(floats.names)
        if np.isfinite(whole.squares[i])
    }
    return Rows(experiment, part, columns(experiment), known, ranges)


def _labels(column: pa.ChunkedArray, labels: tuple[str, ...]) -> Any:
    """The labels' numbers; -1 for a text that is not a label."""
    import pyarrow.compute as pc  # takes 0.04 s, and generating needs it not

    texts = pa.array(labels, pa.string())
    parts = []
    for chunk in column.chunks:
        chunk = chunk if pa.types.is_dictionary(chunk.type) else chunk.dictionary_encode()
        number = pc.fill_null(pc.index_in(chunk.dictionary.cast(pa.string()), value_set=texts), -1).to_numpy()
        parts.append(number[chunk.indices.to_numpy()])
    return np.concatenate(parts)


def _schema(found: pa.Schema, expected: list[Column]) -> str | None:
    """The first column that differs from the expected one; else what the schema says beside the columns."""
    pairs = zip_longest(
        [(field.name, _plain_type(field.type)) for field in found], [(c.name, c.dtype) for c in expected]
    )
    wrong = next((pair for pair in pairs if pair[0] != pair[1]), None)
    return f"found column {wrong[0]}, expected {wrong[1]}" if wrong else foreign_metadata(found)


def foreign_metadata(found: pa.Schema) -> str | None:
    """The metadata of a schema, of which ibdata writes none: pandas would name columns by them."""
    own = [("the file", found.metadata), *((f"column {field.name}", field.metadata) for field in found)]
    where, keys = next(((where, keys) for where, keys in own if keys), ("", None))
    return f"found metadata {sorted(keys)[0]!r} of {where}, expected none" if keys else None


def _plain_type(kind: pa.DataType) -> str:
    """The type of a column as info.json spells it."""
    if pa.types.is_dictionary(kind):
        return "string"
    return {"float": "float32", "double": "float64"}.get(str(kind), str(kind))
