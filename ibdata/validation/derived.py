"""Check the files that follow from the experiments and the rows: they are computed again, and compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa
from pydantic import ValidationError

from ibdata.dataset import manifest
from ibdata.dataset.models import JsonObject, Statistic, Statistics
from ibdata.dataset.stored import EPISODES, INFO, STATISTICS, Stored
from ibdata.errors import DatasetError
from ibdata.experiment import Experiment
from ibdata.experiment.dataset_spec import DatasetSpec, spec_in
from ibdata.experiment.yaml import Document, StrictYamlError
from ibdata.validation.rules import Problem
from ibdata.writing import metadata
from ibdata.writing.finish import experiment_files
from ibdata.writing.planned import first_difference
from ibdata.writing.shard_writer import WrittenShard


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
        found = stored.splits
        expected = metadata.splits(spec_in(stored))
    except DatasetError as error:
        yield Problem.of(error, manifest.SPLITS, stored.storage.where(manifest.SPLITS), "splits")
        return
    given = {name: entry.plain() for name, entry in found.items()}
    right = {name: entry.plain() for name, entry in expected.items()}
    if message := first_difference(given, right):
        yield Problem(manifest.SPLITS, None, "splits", message)


def _info(stored: Stored, spec: DatasetSpec) -> Iterator[Problem]:
    found = _facts(stored.info)
    expected = _facts(metadata.info(spec))
    for rule in expected:
        if message := first_difference(found[rule], expected[rule]):
            yield Problem(INFO, None, rule, message)


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
    found = table.take(numbers)
    for name in expected.column_names:
        given = _plain(found[name])
        right = _plain(expected[name])
        if wrong := _differing(given, right):
            first = wrong[0]
            rule = name if name in ("digest", "return") else "episodes"
            message = f"{name}: found {_shown(given[first])}, expected {_shown(right[first])}"
            count = f" ({len(wrong)} such rows)" if len(wrong) > 1 else ""
            yield Problem(EPISODES, int(numbers[first]), rule, message + count)


def _plain(column: pa.ChunkedArray) -> pa.Array:
    """A column as one array, with its texts instead of dictionary numbers."""
    texts = pa.types.is_dictionary(column.type)
    return (column.cast(pa.string()) if texts else column).combine_chunks()


def _differing(found: pa.Array, expected: pa.Array) -> list[int]:
    """The rows in which two columns differ, but for rounding."""
    if pa.types.is_floating(found.type):
        return np.flatnonzero(~np.isclose(found, expected, rtol=1e-9, atol=1e-9)).tolist()
    if found.equals(expected):
        return []
    pairs = zip(found.to_pylist(), expected.to_pylist(), strict=True)
    return [i for i, (x, y) in enumerate(pairs) if x != y]


def _shown(value: pa.Scalar) -> str:
    plain = value.as_py()
    return f"{plain.hex()[:12]}…" if isinstance(plain, bytes) else f"{plain}"


def _statistics(stored: Stored, expected: Statistics) -> Iterator[Problem]:
    found = stored.statistics
    if message := first_difference(_names(found), _names(expected)):
        yield Problem(STATISTICS, None, "statistics", message)
        return
    pairs = [("", found.all, expected.all)]
    pairs += [(f"split {name}: ", found.splits[name], own) for name, own in expected.splits.items()]
    for where, given, right in pairs:
        for name in right:
            for message in _numbers(given[name], right[name]):
                yield Problem(STATISTICS, None, "statistics", f"{where}{name}: {message}")


def _names(statistics: Statistics) -> dict[str, Any]:
    """The names of the columns, of all rows and of each split."""
    of_splits = {split: sorted(columns) for split, columns in statistics.splits.items()}
    return {"all": sorted(statistics.all), "splits": of_splits}


def _numbers(found: Statistic, expected: Statistic) -> Iterator[str]:
    """Compare the statistics of a column, but for rounding; versions of numpy choose other quantiles."""
    spread = (expected.max or 0.0) - (expected.min or 0.0)
    given = _by_name(found)
    for name, right in _by_name(expected).items():
        tolerance = 0.01 * spread if name in expected.quantiles else 1e-9
        if not _near(given[name], right, tolerance):
            yield f"{name}: found {given[name]}, expected {right}"


def _by_name(statistic: Statistic) -> dict[str, float | None]:
    plain = statistic.plain()
    quantiles: dict[str, float | None] = plain.pop("quantiles")
    return {**plain, **quantiles}


def _near(x: float | None, y: float | None, tolerance: float) -> bool:
    if x is None or y is None:
        return x is y
    return math.isclose(x, y, rel_tol=1e-9, abs_tol=tolerance)
