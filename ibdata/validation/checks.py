"""Check the rows of shards, and the files that follow from them and from the experiments."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from itertools import zip_longest
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from pydantic import ValidationError

from ibdata.dataset import manifest, parquet
from ibdata.dataset.models import JsonObject, Statistic, Statistics
from ibdata.dataset.statistics import Moments
from ibdata.dataset.stored import EPISODES, INFO, STATISTICS, Stored
from ibdata.errors import DatasetError
from ibdata.experiment import Experiment
from ibdata.experiment.columns import Column, columns
from ibdata.experiment.dataset_spec import DatasetSpec, spec_in
from ibdata.experiment.plan import Shard
from ibdata.experiment.yaml import Document, StrictYamlError
from ibdata.system.progress import Advance, unseen
from ibdata.system.storage import storage
from ibdata.validation.rules import RULES, Broken, Problem, Rows, nulls
from ibdata.writing import metadata
from ibdata.writing.columns import Piece, stored_pieces
from ibdata.writing.croissant import croissant
from ibdata.writing.finish import experiment_files, first_difference
from ibdata.writing.shard import ShardSummarizer, ShardSummary, WrittenShard

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
    experiment, summarizer, broken = spec.of_shard(shard), ShardSummarizer(spec, shard), _BrokenRules(path)
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
            for piece in stored_pieces(spec, shard, batches, PART_ROWS):
                if before:
                    before.result()
                before = checking.submit(_check, experiment, shard, piece, summarizer, broken)
                advance((piece.episodes.stop - piece.episodes.first) * experiment.steps)
            if before:
                before.result()
    except DatasetError as error:
        return None, [Problem.of(error, path, storage(place).where(path), "parquet")]
    problems = broken.problems()
    return (None if problems else summarizer.content()), problems


class _BrokenRules:
    """The broken rules of a shard. Parts that break the same rule in the same column make one problem."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._broken: dict[tuple[str, str], Broken] = {}

    def add(self, rule: str, row: int, broken: Iterable[Broken]) -> None:
        """Add what breaks a rule in the part that begins at row `row` of the shard."""
        for rule_broken in broken:
            key = (rule, rule_broken.message.partition(":")[0])
            first = self._broken.get(key, Broken(row + rule_broken.row, rule_broken.message, 0))
            self._broken[key] = first._replace(rows=first.rows + rule_broken.rows)

    def problems(self) -> list[Problem]:
        """The problems, rule by rule."""
        return [
            Problem(self._path, row, rule, message + (f" ({count} such rows)" if count > 1 else ""))
            for (rule, _), (row, message, count) in self._broken.items()
        ]


def _check(
    experiment: Experiment,
    shard: Shard,
    piece: Piece,
    summarizer: ShardSummarizer,
    broken: _BrokenRules,
) -> None:
    """Add a part to the summary, and the rules that it breaks to those found."""
    first = row = (piece.episodes.first - shard.first) * experiment.steps
    whole = True
    for batch in piece.others:
        missing = list(nulls(batch))
        broken.add("nulls", row, missing)
        whole, row = whole and not missing, row + batch.num_rows
    if whole:
        rows = _rows(experiment, piece, summarizer.add(piece))
        for name, rule in RULES.items():
            broken.add(name, first, rule(rows))


def _rows(experiment: Experiment, piece: Piece, described: Moments) -> Rows:
    columns_by_name = dict(zip(piece.floats.names, piece.floats.table, strict=True))
    for name in ("episode", "step", "terminated", "truncated"):
        columns_by_name[name] = pa.chunked_array([batch[name] for batch in piece.others]).to_numpy()
    columns_by_name["policy"] = np.concatenate(
        [_labels(batch["policy"], experiment.labels) for batch in piece.others]
    )
    ranges = {
        name: (float(described.low[i]), float(described.high[i]))
        for i, name in enumerate(piece.floats.names)
        if described.counts[i] == described.rows
    }
    return Rows(experiment, piece.episodes, columns(experiment), columns_by_name, ranges)


def _labels(column: pa.Array, labels: tuple[str, ...]) -> npt.NDArray[np.int32]:
    """The number of the label in each row; -1 for a text that is not a label."""
    import pyarrow.compute as pc  # takes 0.04 s, and generating does not need it

    column = column if pa.types.is_dictionary(column.type) else column.dictionary_encode()
    texts = pa.array(labels, pa.string())
    number = pc.fill_null(pc.index_in(column.dictionary.cast(pa.string()), value_set=texts), -1).to_numpy()
    numbers_of_rows: npt.NDArray[np.int32] = number[column.indices.to_numpy()]
    return numbers_of_rows


def _schema(schema: pa.Schema, expected: list[Column]) -> str | None:
    """Describe the first column whose name or type is not the expected one, if there is one."""
    pairs = zip_longest(
        [(field.name, parquet.plain_type(field.type)) for field in schema],
        [(c.name, c.dtype) for c in expected],
    )
    wrong = next((pair for pair in pairs if pair[0] != pair[1]), None)
    return f"found column {wrong[0]}, expected {wrong[1]}" if wrong else None


def metadata_problems(
    stored: Stored,
    spec: DatasetSpec,
    written: list[WrittenShard],
    is_whole: Callable[[str], bool],
) -> Iterator[Problem]:
    """Check the metadata.

    Args:
        stored: The dataset.
        spec: The experiments and splits of the dataset.
        written: The shards whose rows keep every rule.
        is_whole: Whether the file of a path has the SHA-256 that the manifest lists; others are passed over.
    """
    checks: dict[str, Callable[[], Iterator[Problem]]] = {
        INFO: partial(_info, stored, spec),
        **{
            path: partial(_experiment, stored, path, experiment)
            for path, experiment in experiment_files(spec).items()
        },
        EPISODES: partial(_episodes, stored, spec, written),
    }
    if manifest.CROISSANT in stored.manifest.entries():
        checks[manifest.CROISSANT] = partial(_croissant, stored, spec)
    if len(written) == len(spec.shards):
        checks[STATISTICS] = partial(_statistics, stored, metadata.statistics(spec, written))
    for path, check in checks.items():
        try:
            if is_whole(path):
                yield from check()
        except DatasetError as error:
            yield Problem.of(error, path, stored.storage.where(path), "metadata")


def splits_problems(stored: Stored) -> Iterator[Problem]:
    """Check the splits, of which the manifest lists no SHA-256, because later ones are added to the file."""
    try:
        entries = stored.splits
        expected = metadata.splits(spec_in(stored))
    except DatasetError as error:
        yield Problem.of(error, manifest.SPLITS, stored.storage.where(manifest.SPLITS), "splits")
        return
    stored_plain = {name: entry.plain() for name, entry in entries.items()}
    expected_plain = {name: entry.plain() for name, entry in expected.items()}
    if message := first_difference(stored_plain, expected_plain):
        yield Problem(manifest.SPLITS, None, "splits", message)


def _info(stored: Stored, spec: DatasetSpec) -> Iterator[Problem]:
    stored_facts = _facts(stored.info)
    expected = _facts(metadata.info(spec))
    for rule in expected:
        if message := first_difference(stored_facts[rule], expected[rule]):
            yield Problem(INFO, None, rule, message)


def _croissant(stored: Stored, spec: DatasetSpec) -> Iterator[Problem]:
    """Compare the files and their hashes. What else the description says may be said in other words."""
    data = stored.read(manifest.CROISSANT)
    try:
        stored_files = dict(manifest.loads(data))["distribution"]
    except (ValueError, TypeError, KeyError):
        stored_files = None
    listed = stored.manifest
    shards, entries = metadata.unread_shards(spec, listed), listed.entries().values()
    expected = croissant(spec, shards, entries, listed.content_root)["distribution"]
    if message := first_difference(stored_files, expected, "distribution"):
        yield Problem(manifest.CROISSANT, None, "files", message)


def _facts(info: JsonObject) -> dict[str, Any]:
    """What programs read. The meaning of a column may be said in other words."""
    facts = info.plain()
    for column in facts["columns"]:
        del column["description"]
    return facts


def _experiment(stored: Stored, path: str, expected: Experiment) -> Iterator[Problem]:
    try:
        document = Document(stored.read(path))
        same = Experiment.model_validate(document.data) == expected
    except (StrictYamlError, ValidationError):
        same = False
    if not same:
        yield Problem(path, None, "experiment", "found another experiment than the manifest lists")


def _episodes(stored: Stored, spec: DatasetSpec, written: list[WrittenShard]) -> Iterator[Problem]:
    """Compare the rows of the episodes of these shards, column by column."""
    table = stored.episodes
    if not written:
        return
    expected = metadata.episodes_table(spec, written)
    numbers = expected["episode"].to_numpy()
    stored_rows = table.take(numbers)
    for name in expected.column_names:
        stored_column = _plain(stored_rows[name])
        expected_column = _plain(expected[name])
        if wrong := _differing(stored_column, expected_column):
            first = wrong[0]
            rule = name if name in ("digest", "return") else "episodes"
            message = (
                f"{name}: found {_shown(stored_column[first])}, expected {_shown(expected_column[first])}"
            )
            count = f" ({len(wrong)} such rows)" if len(wrong) > 1 else ""
            yield Problem(EPISODES, int(numbers[first]), rule, message + count)


def _plain(column: pa.ChunkedArray) -> pa.Array:
    """A column as one array, with its texts instead of dictionary numbers."""
    texts = pa.types.is_dictionary(column.type)
    return (column.cast(pa.string()) if texts else column).combine_chunks()


def _differing(column: pa.Array, expected: pa.Array) -> list[int]:
    """The rows in which two columns differ, but for rounding."""
    if pa.types.is_floating(column.type):
        return np.flatnonzero(~np.isclose(column, expected, rtol=1e-9, atol=1e-9)).tolist()
    if column.equals(expected):
        return []
    pairs = zip(column.to_pylist(), expected.to_pylist(), strict=True)
    return [i for i, (x, y) in enumerate(pairs) if x != y]


def _shown(value: pa.Scalar) -> str:
    plain = value.as_py()
    return f"{plain.hex()[:12]}…" if isinstance(plain, bytes) else f"{plain}"


def _statistics(stored: Stored, expected: Statistics) -> Iterator[Problem]:
    statistics = stored.statistics
    if message := first_difference(_names(statistics), _names(expected)):
        yield Problem(STATISTICS, None, "statistics", message)
        return
    pairs = [("", statistics.all, expected.all)]
    pairs += [
        (f"split {name}: ", statistics.splits[name], columns) for name, columns in expected.splits.items()
    ]
    for where, stored_columns, expected_columns in pairs:
        for name in expected_columns:
            for message in _numbers(stored_columns[name], expected_columns[name]):
                yield Problem(STATISTICS, None, "statistics", f"{where}{name}: {message}")


def _names(statistics: Statistics) -> dict[str, Any]:
    """The names of the columns, of all rows and of each split."""
    of_splits = {split: sorted(columns) for split, columns in statistics.splits.items()}
    return {"all": sorted(statistics.all), "splits": of_splits}


def _numbers(statistic: Statistic, expected: Statistic) -> Iterator[str]:
    """Compare the statistics of a column, but for rounding; versions of numpy choose other quantiles."""
    spread = (expected.max or 0.0) - (expected.min or 0.0)
    numbers = _by_name(statistic)
    for name, number in _by_name(expected).items():
        tolerance = 0.01 * spread if name in expected.quantiles else 1e-9
        if not _near(numbers[name], number, tolerance):
            yield f"{name}: found {numbers[name]}, expected {number}"


def _by_name(statistic: Statistic) -> dict[str, float | None]:
    plain = statistic.plain()
    quantiles: dict[str, float | None] = plain.pop("quantiles")
    return {**plain, **quantiles}


def _near(x: float | None, y: float | None, tolerance: float) -> bool:
    if x is None or y is None:
        return x is y
    return math.isclose(x, y, rel_tol=1e-9, abs_tol=tolerance)
