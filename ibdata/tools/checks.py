"""Check the rows of shards, and the files that follow from them and from the experiments."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import zip_longest
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata._system.progress import Advance, unseen
from ibdata._system.storage import Storage
from ibdata.dataset import manifest, parquet
from ibdata.dataset.models import JsonObject, Manifest
from ibdata.dataset.statistics import Moments
from ibdata.dataset.stored import EPISODES_PATH, Stored
from ibdata.errors import DatasetError, reason
from ibdata.experiment import Experiment
from ibdata.experiment.yaml import Document
from ibdata.generation.finish import NEED_CONTENT, first_difference, metadata_contents, root_of
from ibdata.generation.metadata import splits
from ibdata.generation.pieces import Piece, stored_pieces
from ibdata.generation.shard import ShardSummarizer, ShardSummary, WrittenShard
from ibdata.plan.columns import columns
from ibdata.plan.dataset_spec import DatasetSpec, Shard, spec_in
from ibdata.tools.rules import RULES, Broken, Problem, Rows, nulls

PIECE_ROWS = 100_000  # as a row group has, which then is a piece where it holds whole episodes


def check_shard(
    spec: DatasetSpec, shard: Shard, files: Storage, path: str, advance: Advance = unseen
) -> tuple[ShardSummary | None, list[Problem]]:
    """Check the rows of a shard.

    Args:
        spec: The experiments and splits of the dataset.
        shard: The shard.
        files: The files of the dataset.
        path: The path of the shard's file in it.
        advance: Called with the number of rows of each piece.

    Returns:
        The summary of the rows, or None if they break a rule or cannot be read; and the problems.
    """
    experiment, summarizer = spec.experiments[shard.experiment], ShardSummarizer(spec, shard)
    broken: list[tuple[str, Broken]] = []
    try:
        schema, rows = parquet.schema_and_rows(files, path)
        found_columns = [(field.name, parquet.plain_type(field.type)) for field in schema]
        expected_columns = [(column.name, column.dtype) for column in columns(experiment)]
        for found, expected in zip_longest(found_columns, expected_columns):
            if found != expected:
                message = f"found column {found}, expected {expected}"
                return None, [Problem(path, None, "schema", message)]
        expected_rows = (shard.stop - shard.first) * experiment.steps
        if rows != expected_rows:
            message = f"found {rows}, expected {expected_rows} rows of whole episodes"
            return None, [Problem(path, None, "rows", message)]
        batches = parquet.batches(files, path, None, PIECE_ROWS, threads=False)
        with ThreadPoolExecutor(1) as checking:  # while the next piece is read
            before: Future[list[tuple[str, Broken]]] | None = None
            for piece in stored_pieces(spec, shard, batches, PIECE_ROWS):
                if before:
                    broken += before.result()
                before = checking.submit(_broken_rules, shard, piece, summarizer)
                advance((piece.episodes.stop - piece.episodes.first) * experiment.steps)
            if before:
                broken += before.result()
    except DatasetError as error:
        return None, [Problem.of(error, path, files.where(path), "parquet")]
    problems = _problems(path, broken)
    return (None if problems else summarizer.summary()), problems


def _problems(path: str, broken: Iterable[tuple[str, Broken]]) -> list[Problem]:
    """A problem for each rule that is broken in a column, with the first row and the number of rows."""
    by_column: dict[tuple[str, str], Broken] = {}
    for rule, one in broken:
        first = by_column.get((rule, one.column), one._replace(rows=0))
        by_column[rule, one.column] = first._replace(rows=first.rows + one.rows)
    return [
        Problem(path, row, rule, message + (f" ({rows} such rows)" if rows > 1 else ""))
        for (rule, _), (row, _, message, rows) in by_column.items()
    ]


def _broken_rules(shard: Shard, piece: Piece, summarizer: ShardSummarizer) -> list[tuple[str, Broken]]:
    """The rules that a piece breaks, at rows of the shard. If no value is missing, it is summarized."""
    first = row = (piece.episodes.first - shard.first) * piece.experiment.steps
    broken: list[tuple[str, Broken]] = []
    for batch in piece.others:
        broken += [("nulls", each._replace(row=row + each.row)) for each in nulls(batch)]
        row += batch.num_rows
    if not broken:
        rows = _rows(piece, summarizer.add(piece))
        for name, rule in RULES.items():
            broken += [(name, each._replace(row=first + each.row)) for each in rule(rows)]
    return broken


def _rows(piece: Piece, moments: Moments) -> Rows:
    columns_by_name = dict(zip(piece.floats.names, piece.floats.table, strict=True))
    for name in ("episode", "step", "terminated", "truncated"):
        columns_by_name[name] = pa.chunked_array([batch[name] for batch in piece.others]).to_numpy()
    columns_by_name["policy"] = np.concatenate(
        [_labels(batch["policy"], piece.experiment.labels) for batch in piece.others]
    )
    ranges = {
        name: (float(moments.low[i]), float(moments.high[i]))
        for i, name in enumerate(piece.floats.names)
        if moments.counts[i] == moments.rows
    }
    return Rows(piece.experiment, piece.episodes, columns(piece.experiment), columns_by_name, ranges)


def _labels(column: pa.Array, labels: tuple[str, ...]) -> npt.NDArray[np.int32]:
    """The number of the label in each row; -1 for a text that is not a label."""
    import pyarrow.compute as pc  # takes 0.04 s, and generating does not need it

    column = column if pa.types.is_dictionary(column.type) else column.dictionary_encode()
    texts = pa.array(labels, pa.string())
    number = pc.fill_null(pc.index_in(column.dictionary.cast(pa.string()), value_set=texts), -1).to_numpy()
    numbers_of_rows: npt.NDArray[np.int32] = number[column.indices.to_numpy()]
    return numbers_of_rows


def metadata_problems(
    stored: Stored, spec: DatasetSpec, written: list[WrittenShard], is_whole: Callable[[str], bool]
) -> Iterator[Problem]:
    """Compare the files in `meta` with those that follow from the experiments and the rows.

    Args:
        stored: The dataset.
        spec: The experiments and splits of the dataset.
        written: The shards whose rows keep every rule. What follows from rows is compared if these are all.
        is_whole: Whether the file of a path has the SHA-256 that the manifest lists; others are passed over.
    """
    are_all, entries = len(written) == len(spec.shards), stored.manifest.entries()
    for path, make in metadata_contents(spec, written, entries, stored.manifest.content_root).items():
        is_known = are_all or path not in NEED_CONTENT
        is_named_by_hash = manifest.WEIGHTS.fullmatch(path)
        if path not in entries or not is_known or is_named_by_hash or not is_whole(path):
            continue
        expected = _plain(make())
        try:
            found = _facts(stored, path, spec)
            if path == manifest.CROISSANT and isinstance(found, dict):  # what else it has is prose
                found, expected = ({"distribution": x.get("distribution")} for x in (found, expected))
            message = first_difference(found, expected)
        except DatasetError as error:
            yield Problem.of(error, path, stored.storage.where(path), "metadata")
        except (ValueError, pa.ArrowException) as error:
            yield Problem(path, None, "metadata", f"found other content than ibdata writes ({reason(error)})")
        else:
            if message:
                yield Problem(path, None, "metadata", message)


def _plain(content: pa.Table | Experiment | JsonObject | dict[str, Any]) -> Any:
    """The content of a file of `meta` as plain data."""
    if isinstance(content, pa.Table):
        return {name: content[name].to_pylist() for name in content.column_names}
    return content if isinstance(content, dict) else content.plain()


def _facts(stored: Stored, path: str, spec: DatasetSpec) -> Any:
    """The content of a file of `meta` that is there, as plain data."""
    data = stored.read(path)
    if path == EPISODES_PATH:
        return _plain(parquet.read(stored.storage, path, data=data))
    if path.endswith(".yaml"):
        context = spec.experiments[0].checked_with
        return Experiment.model_validate(Document(data).data, context=context).plain()
    return manifest.loads(data)


def root_problems(
    spec: DatasetSpec, listed: Manifest, shards: Iterable[tuple[Shard, list[bytes]]]
) -> Iterator[Problem]:
    """Compare the content root with that of the experiments and of all shards, each with its digests."""
    if (root := root_of(spec, shards)) != listed.content_root:
        message = f"found {listed.content_root}, expected {root}"
        yield Problem(manifest.PATH, None, "content root", message)


def splits_problems(stored: Stored) -> Iterator[Problem]:
    """Check the splits, of which the manifest lists no SHA-256, because later ones are added to the file."""
    try:
        entries = stored.splits
        expected = splits(spec_in(stored))
    except DatasetError as error:
        yield Problem.of(error, manifest.SPLITS, stored.storage.where(manifest.SPLITS), "splits")
        return
    found, wanted = ({name: entry.plain() for name, entry in x.items()} for x in (entries, expected))
    if message := first_difference(found, wanted):
        yield Problem(manifest.SPLITS, None, "splits", message)
