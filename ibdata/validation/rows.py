"""Check the rows of a shard against every rule, part by part, and summarize them."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import zip_longest
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata.dataset import parquet
from ibdata.dataset.statistics import Moments
from ibdata.errors import DatasetError
from ibdata.experiment import Experiment
from ibdata.experiment.columns import Column, columns
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.system.progress import Advance, unseen
from ibdata.system.storage import storage
from ibdata.validation.rules import RULES, Broken, Problem, Rows, nulls
from ibdata.writing.stored import Part, stored_parts
from ibdata.writing.summary import ShardSummarizer, ShardSummary

PART_ROWS = 100_000  # as a row group has, which then is a part where it holds whole episodes


def check_shard(
    spec: DatasetSpec,
    shard: Shard,
    place: Any,
    path: str,
    advance: Advance = unseen,
) -> tuple[ShardSummary | None, list[Problem]]:
    """Check the rows of a shard.

    Args:
        spec: The experiments and splits of the dataset.
        shard: The shard.
        place: The dataset's folder or storage.
        path: The path of the shard's file in it.
        advance: Called with the number of rows of each part.

    Returns:
        The summary of the rows, or None if they break a rule or cannot be read; and the problems.
    """
    experiment, account, found = spec.of_shard(shard), ShardSummarizer(spec, shard), _Found(path)
    try:
        schema, rows = parquet.described(place, path)
        expected = (shard.stop - shard.first) * experiment.steps
        if wrong := _schema(schema, columns(experiment)):
            return None, [Problem(path, None, "schema", wrong)]
        if rows != expected:
            message = f"found {rows}, expected {expected} rows of whole episodes"
            return None, [Problem(path, None, "rows", message)]
        batches = parquet.batches(place, path, None, PART_ROWS, threads=False)
        with ThreadPoolExecutor(1) as checking:  # while the next part is read
            before: Future[None] | None = None
            for part in stored_parts(spec, shard, batches, PART_ROWS):
                if before:
                    before.result()
                before = checking.submit(_check, experiment, shard, part, account, found)
                advance((part.episodes.stop - part.episodes.first) * experiment.steps)
            if before:
                before.result()
    except DatasetError as error:
        return None, [Problem.of(error, path, storage(place).where(path), "parquet")]
    problems = found.problems()
    return (None if problems else account.content()), problems


class _Found:
    """The broken rules of a shard. Parts that break the same rule in the same column make one problem."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._broken: dict[tuple[str, str], Broken] = {}

    def add(self, rule: str, row: int, broken: Iterable[Broken]) -> None:
        """Add what breaks a rule in the part that begins at row `row` of the shard."""
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


def _check(
    experiment: Experiment,
    shard: Shard,
    part: Part,
    account: ShardSummarizer,
    found: _Found,
) -> None:
    """Add a part to the summary, and the rules that it breaks to those found."""
    first = row = (part.episodes.first - shard.first) * experiment.steps
    whole = True
    for batch in part.others:
        missing = list(nulls(batch))
        found.add("nulls", row, missing)
        whole, row = whole and not missing, row + batch.num_rows
    if whole:
        own = _rows(experiment, part, account.add(part.episodes, part.floats))
        for name, rule in RULES.items():
            found.add(name, first, rule(own))


def _rows(experiment: Experiment, part: Part, described: Moments) -> Rows:
    known = dict(zip(part.floats.names, part.floats.table, strict=True))
    for name in ("episode", "step", "terminated", "truncated"):
        known[name] = pa.chunked_array([batch[name] for batch in part.others]).to_numpy()
    known["policy"] = np.concatenate([_labels(batch["policy"], experiment.labels) for batch in part.others])
    ranges = {
        name: (float(described.low[i]), float(described.high[i]))
        for i, name in enumerate(part.floats.names)
        if np.isfinite(described.squares[i])
    }
    return Rows(experiment, part.episodes, columns(experiment), known, ranges)


def _labels(column: pa.Array, labels: tuple[str, ...]) -> npt.NDArray[np.int32]:
    """The number of the label in each row; -1 for a text that is not a label."""
    import pyarrow.compute as pc  # takes 0.04 s, and generating does not need it

    column = column if pa.types.is_dictionary(column.type) else column.dictionary_encode()
    texts = pa.array(labels, pa.string())
    number = pc.fill_null(pc.index_in(column.dictionary.cast(pa.string()), value_set=texts), -1).to_numpy()
    found: npt.NDArray[np.int32] = number[column.indices.to_numpy()]
    return found


def _schema(found: pa.Schema, expected: list[Column]) -> str | None:
    """Describe the first column whose name or type is not the expected one, if there is one."""
    pairs = zip_longest(
        [(field.name, parquet.plain_type(field.type)) for field in found],
        [(c.name, c.dtype) for c in expected],
    )
    wrong = next((pair for pair in pairs if pair[0] != pair[1]), None)
    return f"found column {wrong[0]}, expected {wrong[1]}" if wrong else None
