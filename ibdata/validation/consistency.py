"""Check that manifest, metadata and card follow from the experiments and the rows."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pyarrow as pa
from pydantic import ValidationError

from ibdata.dataset import manifest
from ibdata.dataset.episodes import PATH as EPISODES
from ibdata.dataset.episodes import read_episodes
from ibdata.dataset.models import Info, Manifest, Statistic, Statistics
from ibdata.errors import DatasetError
from ibdata.experiment import Experiment, as_yaml
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.yaml import Document, StrictYamlError
from ibdata.system.storage import is_url, storage
from ibdata.validation.rules import Problem
from ibdata.writing import metadata
from ibdata.writing.card import card, machine_readable
from ibdata.writing.finish import experiment_files, metadata_files, planned_entry, root_of, versions
from ibdata.writing.metadata import unread_shards
from ibdata.writing.shard_writer import WrittenShard

INFO, STATS = "meta/dataset.json", "meta/statistics.json"


def check_plan(spec: DatasetSpec, listed: Manifest) -> Iterator[Problem]:
    """Check that the shards, files and code that a manifest lists follow from its experiments.

    Args:
        spec: The experiments and splits that the manifest lists.
        listed: The manifest.

    Returns:
        The first problem of each kind.
    """
    if spec.least_shards > len(listed.shards):  # a list of so many could fill the memory
        message = f"shards: found {len(listed.shards)}, expected at least {spec.least_shards}"
        yield Problem(manifest.PATH, None, "experiments", message)
        return
    shards = [entry.model_dump(exclude={"path", "content"}) for entry in listed.shards]
    files = sorted(file.path for file in listed.files if file.path != manifest.REPORT)
    planned = sorted([*(entry.path for entry in listed.shards), *metadata_files(spec, [], "")])
    targets = list(dict.fromkeys(code.target for code in listed.code))
    yield from _differing(
        manifest.PATH,
        ("experiments", {"shards": shards}, {"shards": [planned_entry(spec, each) for each in spec.shards]}),
        ("rows", listed.rows, spec.rows),
        ("files", files, planned),
        ("code", targets, spec.code_targets),
    )
    if listed.clipped_actions > listed.rows:
        message = f"clipped_actions: found {listed.clipped_actions}, expected at most one per row"
        yield Problem(manifest.PATH, None, "counts", message)
    if listed.code and listed.reproducible is True:
        message = 'reproducible: found true, expected "same-environment" or false for custom policies'
        yield Problem(manifest.PATH, None, "code", message)


def refuse_other_plan(spec: DatasetSpec, listed: Manifest) -> None:
    """Raise DatasetError if what a manifest lists does not follow from its experiments."""
    for problem in check_plan(spec, listed):
        raise DatasetError(f"{problem}; see ibdata validate")


def proven_root(spec: DatasetSpec, listed: Manifest, written: list[WrittenShard]) -> str:
    """The content root of the rows if all shards keep every rule; otherwise the listed one."""
    if len(written) < len(spec.shards):
        return listed.content_root
    return root_of(spec, ((w.shard, w.content.digests) for w in written))


def checks(
    folder: Any, listed: Manifest, spec: DatasetSpec, written: list[WrittenShard], root: str
) -> Iterator[tuple[str, Iterator[Problem]]]:
    """The checks of the metadata and the card.

    Args:
        folder: The folder of the dataset.
        listed: Its manifest.
        spec: The experiments and splits that the manifest lists.
        written: The shards whose rows keep every rule.
        root: The content root.

    Returns:
        For each file its path, and an iterator over its problems.
    """
    shards = unread_shards(spec, listed)
    table = metadata.episodes_table(spec, written) if len(written) == len(shards) else None
    yield EPISODES, _episodes(folder, listed, spec, written, table)
    if table is not None:
        yield STATS, _statistics(folder, listed, metadata.statistics(spec, written))
        yield (
            manifest.CARD,
            _card(folder, listed, card(DatasetSpec(spec.name, spec.experiments), shards, root, table)),
        )
    yield INFO, _info(folder, listed, metadata.info(spec))
    for path, experiment in experiment_files(spec).items():
        yield path, _experiment(folder, listed, path, experiment)


def _same_version(listed: Manifest, *of: str) -> bool:
    """Whether these packages have the versions that wrote the dataset; if not, texts or digits may differ."""
    return all(listed.versions.get(name) == versions()[name] for name in of)


def _info(folder: Any, listed: Manifest, expected: Info) -> Iterator[Problem]:
    found, right = manifest.read_json(folder, listed, INFO, Info).plain(), expected.plain()
    if not _same_version(listed, "ibdata"):
        for column in [*found["columns"], *right["columns"]]:
            column["description"] = ""
    yield from _differing(INFO, *((key, found[key], right[key]) for key in right))


def _differing(path: str, *compared: tuple[str, Any, Any]) -> Iterator[Problem]:
    """Yield a problem for each (rule, found, expected) whose JSON data differ."""
    for rule, found, expected in compared:
        message = _difference(found, expected)
        if message is not None:
            yield Problem(path, None, rule, message)


def _difference(found: Any, expected: Any, *keys: object) -> str | None:
    """Describe the first difference of JSON data, which are at `keys`; None if they are equal."""
    place = f"{'.'.join(map(str, keys))}: " if keys else ""
    pairs: Iterable[tuple[object, Any, Any]] = ()
    if isinstance(found, dict) and isinstance(expected, dict):
        pairs = [(k, found.get(k), expected.get(k)) for k in dict.fromkeys([*expected, *found])]
    elif isinstance(found, list) and isinstance(expected, list) and len(found) == len(expected):
        pairs = zip(range(len(found)), found, expected, strict=True)
    elif found != expected or isinstance(found, bool) != isinstance(expected, bool):
        return f"{place}found {_shown(found)}, expected {_shown(expected)}"
    for key, a, b in pairs:
        if inner := _difference(a, b, *keys, key):
            return inner
    if isinstance(found, dict) and list(found) != list(expected):
        return f"{place}found the right keys in another order"
    return None


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return f"{len(value)} values"
    return json.dumps(value)[:60]


def _card(folder: Any, listed: Manifest, expected: bytes) -> Iterator[Problem]:
    """Compare the card; if an earlier or later ibdata wrote it, only the lines that programs read."""
    found = manifest.listed_content(folder, listed, manifest.CARD)
    same = found == expected
    if not _same_version(listed, "ibdata"):
        same = machine_readable(found) == machine_readable(expected)
    if not same:
        todo = "" if is_url(folder) else f"; ibdata card {storage(folder).name} writes it again"
        yield Problem(manifest.CARD, None, "card", f"found a card that does not fit the dataset{todo}")


def _experiment(folder: Any, listed: Manifest, path: str, experiment: Experiment) -> Iterator[Problem]:
    data = manifest.listed_content(folder, listed, path)
    same = data == as_yaml(experiment)
    if not same and not _same_version(listed, "ibdata"):  # another version may format it differently
        with suppress(StrictYamlError, ValidationError):
            same = Experiment.model_validate(Document(data).data) == experiment
    if not same:
        yield Problem(path, None, "experiment", "found another experiment than the manifest lists")


def _episodes(
    folder: Any, listed: Manifest, spec: DatasetSpec, written: list[WrittenShard], expected: pa.Table | None
) -> Iterator[Problem]:
    found = read_episodes(folder, listed)
    digests, returns = found["digest"].to_pylist(), found["return"].to_numpy()
    for w in written:
        own = slice(w.shard.first + w.shard.offset, w.shard.stop + w.shard.offset)
        steps, path = spec.of_shard(w.shard).steps, w.entry.path
        for i, (digest, right) in enumerate(zip(w.content.digests, digests[own], strict=True)):
            if digest != right:
                message = "found other content than episodes.parquet lists"
                yield Problem(path, i * steps, "digest", message)
        wrong = ~np.isclose(w.content.returns, returns[own], rtol=1e-9, atol=1e-9)
        if wrong.any():
            message = "found another sum of rewards than episodes.parquet lists"
            yield Problem(path, int(np.argmax(wrong)) * steps, "return", message)
    if expected is not None:
        yield from _addresses(found, expected)


def _addresses(found: pa.Table, expected: pa.Table) -> Iterator[Problem]:
    """Compare all columns of episodes.parquet except digest and return."""
    for name in expected.column_names:
        a, b = (_plain(table[name]) for table in (found, expected))
        if name not in ("digest", "return") and not a.equals(b):
            x, y = a.to_pylist(), b.to_pylist()
            row = next(i for i in range(len(y)) if x[i] != y[i])
            yield Problem(EPISODES, row, "episodes", f"{name}: found {x[row]}, expected {y[row]}")


def _plain(column: pa.ChunkedArray) -> pa.Array:
    """A column as one array, with its texts instead of dictionary numbers."""
    texts = pa.types.is_dictionary(column.type)
    return (column.cast(pa.string()) if texts else column).combine_chunks()


def _statistics(folder: Any, listed: Manifest, expected: Statistics) -> Iterator[Problem]:
    """Compare the statistics of all rows and of each split."""
    found = manifest.read_json(folder, listed, STATS, Statistics)
    if list(found.splits) != list(expected.splits):
        message = f"found splits {list(found.splits)}, expected {list(expected.splits)}"
        yield Problem(STATS, None, "splits", message)
        return
    tables = [("", found.all, expected.all)]
    tables += [(f"split {name}: ", found.splits[name], table) for name, table in expected.splits.items()]
    exact = _same_version(listed, "ibdata", "numpy")
    for where, given, right in tables:
        if list(given) != list(right):
            message = f"{where}found columns {list(given)}, expected {list(right)}"
            yield Problem(STATS, None, "statistics", message)
            continue
        for name in right:
            yield from _numbers(f"{where}{name}: ", given[name], right[name], exact)


def _numbers(where: str, found: Statistic, expected: Statistic, exact: bool) -> Iterator[Problem]:
    """Compare the statistics of one column; another numpy may choose other quantiles of a sample."""
    spread = 0.0
    if not exact and expected.min is not None and expected.max is not None:
        spread = 0.01 * (expected.max - expected.min)
    if list(found.quantiles) != list(expected.quantiles):
        message = f"{where}found quantiles {list(found.quantiles)}, expected {list(expected.quantiles)}"
        yield Problem(STATS, None, "statistics", message)
        return
    given, right = ({**of.model_dump(exclude={"quantiles"}), **of.quantiles} for of in (found, expected))
    for key, y in right.items():
        x, near = given[key], spread if key in expected.quantiles else 1e-9
        if x != y and (x is None or y is None or not np.isclose(x, y, rtol=1e-9, atol=near)):
            yield Problem(STATS, None, "statistics", f"{where}{key}: found {x}, expected {y}")
