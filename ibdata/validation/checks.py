"""Check the rows of shards, and the files that follow from them and from the experiments."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import zip_longest
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from ibdata.dataset import manifest, parquet
from ibdata.dataset.statistics import Moments
from ibdata.dataset.stored import Stored
from ibdata.errors import DatasetError
from ibdata.experiment import Experiment
from ibdata.experiment.columns import Column, columns
from ibdata.experiment.dataset_spec import DatasetSpec, Shard, spec_in
from ibdata.experiment.yaml import Document
from ibdata.system.progress import Advance, unseen
from ibdata.system.storage import Storage, reason
from ibdata.validation.rules import RULES, Broken, Problem, Rows, nulls
from ibdata.writing import metadata
from ibdata.writing.columns import Piece, stored_pieces
from ibdata.writing.croissant import croissant
from ibdata.writing.finish import NEED_CONTENT, first_difference, metadata_files, metadata_paths
from ibdata.writing.shard import ShardSummarizer, ShardSummary, WrittenShard

PART_ROWS = 100_000  # as a row group has, which then is a part where it holds whole episodes


def check_shard(
    spec: DatasetSpec,
    shard: Shard,
    files: Storage,
    path: str,
    advance: Advance = unseen,
) -> tuple[ShardSummary | None, list[Problem]]:
    """Check the rows of a shard.

    Args:
        spec: The experiments and splits of the dataset.
        shard: The shard.
        files: The files of the dataset.
        path: The path of the shard's file in it.
        advance: Called with the number of rows of each part.

    Returns:
        The summary of the rows, or None if they break a rule or cannot be read; and the problems.
    """
    experiment = spec.experiments[shard.experiment]
    summarizer, broken = ShardSummarizer(spec, shard), _BrokenRules(path)
    try:
        schema, rows = parquet.described(files, path)
        expected = (shard.stop - shard.first) * experiment.steps
        if wrong := _schema(schema, columns(experiment)):
            return None, [Problem(path, None, "schema", wrong)]
        if rows != expected:
            message = f"found {rows}, expected {expected} rows of whole episodes"
            return None, [Problem(path, None, "rows", message)]
        batches = parquet.batches(files, path, None, PART_ROWS, threads=False)
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
        return None, [Problem.of(error, path, files.where(path), "parquet")]
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
    """Compare the files in `meta` with those that follow from the experiments and the rows.

    Args:
        stored: The dataset.
        spec: The experiments and splits of the dataset.
        written: The shards whose rows keep every rule. What follows from rows is compared if these are all.
        is_whole: Whether the file of a path has the SHA-256 that the manifest lists; others are passed over.
    """
    listed, are_all = stored.manifest, len(written) == len(spec.shards)
    entries = listed.entries()
    paths = {path for path in metadata_paths(spec) if path in entries and is_whole(path)}
    paths -= {path for path in paths if manifest.WEIGHTS.fullmatch(path)}  # whose names have their hash
    expected = dict(metadata_files(paths - set(() if are_all else NEED_CONTENT), spec, written))
    if manifest.CROISSANT in paths:
        shards = metadata.unread_shards(spec, listed)
        description = croissant(spec, shards, entries.values(), listed.content_root)
        expected[manifest.CROISSANT] = metadata.as_json(description)
    for path, data in expected.items():
        try:
            message = first_difference(_facts(path, stored.read(path)), _facts(path, data))
        except DatasetError as error:
            yield Problem.of(error, path, stored.storage.where(path), "metadata")
        except (ValueError, pa.ArrowException) as error:
            yield Problem(path, None, "metadata", f"found other content than ibdata writes ({reason(error)})")
        else:
            if message:
                yield Problem(path, None, "metadata", message)


def _facts(path: str, data: bytes) -> Any:
    """What programs read in a file of `meta`. The prose of a description may be said in other words."""
    if path.endswith(".parquet"):
        table = pq.read_table(io.BytesIO(data))
        return {name: table[name].to_pylist() for name in table.column_names}
    if path.endswith(".yaml"):
        return Experiment.model_validate(Document(data).data).plain()
    if path == manifest.CROISSANT:
        return {"distribution": dict(manifest.loads(data)).get("distribution")}
    return manifest.loads(data)


def splits_problems(stored: Stored) -> Iterator[Problem]:
    """Check the splits, of which the manifest lists no SHA-256, because later ones are added to the file."""
    try:
        entries = stored.splits
        expected = metadata.splits(spec_in(stored))
    except DatasetError as error:
        yield Problem.of(error, manifest.SPLITS, stored.storage.where(manifest.SPLITS), "splits")
        return
    plain, expected_plain = ({name: entry.plain() for name, entry in x.items()} for x in (entries, expected))
    if message := first_difference(plain, expected_plain):
        yield Problem(manifest.SPLITS, None, "splits", message)
