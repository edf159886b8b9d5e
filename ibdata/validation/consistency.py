"""Whether the files beside the shards are those that follow from the experiment and the rows."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pydantic import ValidationError

from ibdata.dataset import manifest, shape
from ibdata.dataset.episodes import PATH as EPISODES
from ibdata.dataset.episodes import read_episodes
from ibdata.errors import DatasetError
from ibdata.experiment import Experiment, as_yaml
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.yaml import Document, StrictYamlError
from ibdata.system.atomic_files import FileEntry
from ibdata.validation.rules import Problem
from ibdata.writing import metadata
from ibdata.writing.card import card
from ibdata.writing.finish import experiment_files, root_of, versions
from ibdata.writing.shard_writer import WrittenShard
from ibdata.writing.summary import UNREAD

INFO, STATS = "meta/info.json", "meta/stats.json"


def check_plan(spec: DatasetSpec, listed: dict[str, Any]) -> Iterator[Problem]:
    """What the manifest says of shards, files and code follows from its experiments."""
    expected = [
        {
            "rows": (shard.stop - shard.first) * spec.of_shard(shard).steps,
            "experiment": shard.experiment,
            "episodes": [shard.first + shard.offset, shard.stop + shard.offset],
            "splits": list(shard.splits),
        }
        for shard in spec.shards
    ]
    found = [{key: each[key] for key in expected[0]} for each in listed["shards"]]
    plan = {
        "shards": (found, expected),
        "rows": (listed["rows"], spec.rows),
        "files": (sorted(file["path"] for file in listed["files"] if file["path"] != manifest.REPORT),
                  sorted([*(shard["path"] for shard in listed["shards"]), *beside(spec)])),
        "code": (list(dict.fromkeys(code["target"] for code in listed["code"])), spec.code_targets),
    }  # fmt: skip
    for key, (given, right) in plan.items():
        yield from _different(manifest.PATH, "experiments" if key == "shards" else key, given, right, key)
    if listed["data_version"] > manifest.DATA_VERSION:
        message = f"data_version: found {listed['data_version']}, expected at most {manifest.DATA_VERSION}"
        yield Problem(manifest.PATH, None, "versions", message)
    if listed["clipped_actions"] > listed["rows"]:
        message = f"clipped_actions: found {listed['clipped_actions']}, expected at most one a row"
        yield Problem(manifest.PATH, None, "counts", message)
    if listed["code"] and listed["reproducible"] is True:
        message = 'reproducible: found true, expected "same-environment" or false for custom policies'
        yield Problem(manifest.PATH, None, "code", message)


def refuse_other_plan(spec: DatasetSpec, listed: dict[str, Any]) -> None:
    """DatasetError where the manifest lists other files or episodes than its experiments have."""
    for problem in check_plan(spec, listed):
        raise DatasetError(f"{problem}; see ibdata validate")


def beside(spec: DatasetSpec) -> list[str]:
    """The paths of the files beside the shards, but for the manifest and a report."""
    return [INFO, EPISODES, STATS, *experiment_files(spec), manifest.CARD]


def proven_root(spec: DatasetSpec, listed: dict[str, Any], written: list[WrittenShard]) -> str:
    """The content root of the rows, where those of all shards keep every rule; else the one listed."""
    if len(written) < len(spec.shards):
        return str(listed["content_root"])
    return root_of(spec, ((w.shard, w.content.digests) for w in written))


def checks(
    folder: Path, listed: dict[str, Any], spec: DatasetSpec, written: list[WrittenShard], root: str
) -> Iterator[tuple[str, Iterator[Problem]]]:
    """The check of each file beside the shards, given the shards whose rows keep every rule, and the root."""
    entries = {file["path"]: FileEntry(**file) for file in listed["files"]}
    shards = [
        WrittenShard(shard, entries[each["path"]], UNREAD)
        for shard, each in zip(spec.shards, listed["shards"], strict=True)
    ]
    yield EPISODES, _episodes(folder, listed, spec, written)
    if len(written) == len(shards):
        yield STATS, _statistics(folder, listed, metadata.stats(spec, written))
    yield INFO, _info(folder, listed, metadata.info(spec, shards))
    for path, experiment in experiment_files(spec).items():
        yield path, _experiment(folder, listed, path, experiment)
    if _same_version(listed, "ibdata"):
        yield manifest.CARD, _card(folder, listed, card(spec, shards, root))


def _same_version(listed: dict[str, Any], *of: str) -> bool:
    """Whether what wrote the dataset is what runs now; else texts, and last digits, may be others."""
    return all(listed["versions"].get(name) == versions()[name] for name in of)


def _info(folder: Path, listed: dict[str, Any], expected: dict[str, Any]) -> Iterator[Problem]:
    found = manifest.read_json(folder, listed, INFO, shape.Info)
    if not _same_version(listed, "ibdata"):
        for column in [*found["columns"], *expected["columns"]]:
            column["description"] = ""
    for key in expected:
        yield from _different(INFO, key, found[key], json.loads(json.dumps(expected[key])), key)


def _different(path: str, rule: str, found: Any, expected: Any, key: str) -> Iterator[Problem]:
    """The first place at which JSON data differ."""
    if isinstance(found, dict) and isinstance(expected, dict):
        for name in dict.fromkeys([*expected, *found]):
            inner = list(_different(path, rule, found.get(name), expected.get(name), f"{key}.{name}"))
            if inner:
                yield inner[0]
                return
        if list(found) != list(expected):
            yield Problem(path, None, rule, f"{key}: found the right keys in another order")
    elif isinstance(found, list) and isinstance(expected, list) and len(found) == len(expected):
        for i, pair in enumerate(zip(found, expected, strict=True)):
            inner = list(_different(path, rule, *pair, f"{key}.{i}"))
            if inner:
                yield inner[0]
                return
    elif found != expected or isinstance(found, bool) != isinstance(expected, bool):
        yield Problem(path, None, rule, f"{key}: found {_shown(found)}, expected {_shown(expected)}")


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return f"{len(value)} values"
    return f"{json.dumps(value)[:60]}"


def _card(folder: Path, listed: dict[str, Any], expected: bytes) -> Iterator[Problem]:
    if manifest.listed_content(folder, listed, manifest.CARD) != expected:
        message = f"found another card than that of the dataset; ibdata card {folder} writes it again"
        yield Problem(manifest.CARD, None, "card", message)


def _experiment(folder: Path, listed: dict[str, Any], path: str, experiment: Experiment) -> Iterator[Problem]:
    data = manifest.listed_content(folder, listed, path)
    same = data == as_yaml(experiment)
    if not same and not _same_version(listed, "ibdata"):  # another version may write it in other words
        with suppress(StrictYamlError, ValidationError):
            same = Experiment.model_validate(Document(data).data) == experiment
    if not same:
        yield Problem(path, None, "experiment", "found another experiment than the manifest lists")


def _episodes(
    folder: Path, listed: dict[str, Any], spec: DatasetSpec, written: list[WrittenShard]
) -> Iterator[Problem]:
    found = read_episodes(folder, listed)
    digests, returns = found["digest"].to_pylist(), found["return"].to_numpy()
    for w in written:
        own = slice(w.shard.first + w.shard.offset, w.shard.stop + w.shard.offset)
        steps, path = spec.of_shard(w.shard).steps, w.entry.path
        for i, (digest, expected) in enumerate(zip(w.content.digests, digests[own], strict=True)):
            if digest != expected:
                message = "found other content than episodes.parquet lists"
                yield Problem(path, i * steps, "digest", message)
        wrong = ~np.isclose(w.content.returns, returns[own], rtol=1e-9, atol=1e-9)
        if wrong.any():
            message = "found another sum of rewards than episodes.parquet lists"
            yield Problem(path, int(np.argmax(wrong)) * steps, "return", message)
    if len(written) == len(spec.shards):
        yield from _addresses(found, metadata.episodes_table(spec, written))


def _addresses(found: pa.Table, expected: pa.Table) -> Iterator[Problem]:
    """What episodes.parquet says of each episode but its digest and its return."""
    for name in expected.column_names:
        a, b = (_plain(table[name]) for table in (found, expected))
        if name not in ("digest", "return") and not a.equals(b):
            x, y = a.to_pylist(), b.to_pylist()
            row = next(i for i in range(len(y)) if x[i] != y[i])
            yield Problem(EPISODES, row, "episodes", f"{name}: found {x[row]}, expected {y[row]}")


def _plain(column: pa.ChunkedArray) -> pa.Array:
    """A column in one piece, texts as themselves."""
    texts = pa.types.is_dictionary(column.type)
    return (column.cast(pa.string()) if texts else column).combine_chunks()


def _statistics(folder: Path, listed: dict[str, Any], expected: dict[str, Any]) -> Iterator[Problem]:
    """Counts, moments, extremes and quantiles, over all rows and over each split."""
    found = manifest.read_json(folder, listed, STATS, shape.Stats)
    if list(found["splits"]) != list(expected["splits"]):
        message = f"found splits {list(found['splits'])}, expected {list(expected['splits'])}"
        yield Problem(STATS, None, "splits", message)
        return
    tables = [("", found["all"], expected["all"])]
    tables += [
        (f"split {name}: ", found["splits"][name], table) for name, table in expected["splits"].items()
    ]
    exact = _same_version(listed, "ibdata", "numpy")
    for where, given, right in tables:
        if list(given) != list(right):
            message = f"{where}found columns {list(given)}, expected {list(right)}"
            yield Problem(STATS, None, "statistics", message)
            continue
        for name in right:
            yield from _numbers(f"{where}{name}: ", given[name], right[name], exact)


def _numbers(where: str, found: dict[str, Any], expected: dict[str, Any], exact: bool) -> Iterator[Problem]:
    """The numbers of one column; ranks of an even sample may be others with another numpy."""
    given = {**found, **found["quantiles"]}
    right = {**expected, **expected["quantiles"]}
    spread = 0.0 if exact or right["max"] is None else 0.01 * (right["max"] - right["min"])
    if list(given) != list(right):
        yield Problem(STATS, None, "statistics", f"{where}found {list(given)}, expected {list(right)}")
        return
    for key in right.keys() - {"quantiles"}:
        x, y = given[key], right[key]
        near = spread if key in expected["quantiles"] else 1e-9
        if x != y and (x is None or y is None or not np.isclose(x, y, rtol=1e-9, atol=near)):
            yield Problem(STATS, None, "statistics", f"{where}{key}: found {x}, expected {y}")
