"""Whether a dataset is what its manifest says: files, metadata, and every rule of its rows."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import reduce
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ibdata.dataset import manifest
from ibdata.dataset.digest import content_root
from ibdata.dataset.files import file_sha256
from ibdata.dataset.metadata import as_json
from ibdata.dataset.rules import Problem, check_shard, nulls
from ibdata.dataset.statistics import Moments, merged, moments
from ibdata.errors import DatasetError


def validate(folder: Path, quick: bool = False) -> list[Problem]:
    """Every problem of the dataset in a folder; none means that it is whole. Runs no code of the dataset.

    quick compares the SHA-256 of every file only. Else also: schema, no nulls, finite, bounds, order,
    flags, continuity, reward identity, setpoints, episode digests, content root, counts, statistics.
    """
    try:
        listed = manifest.read(folder)
    except DatasetError as error:
        return [Problem(manifest.PATH, None, "manifest", str(error))]
    if manifest.content(folder, manifest.PATH) != as_json(listed):
        message = "found the content in other bytes, expected those that ibdata writes"
        return [Problem(manifest.PATH, None, "manifest", message)]
    problems = list(check_files(folder, listed))
    if quick:
        return problems
    damaged = {problem.path for problem in problems}
    if damaged & set(manifest.METADATA):
        return problems
    return [*problems, *_contents(folder, listed, damaged)]


def check_files(folder: Path, listed: dict[str, Any]) -> Iterator[Problem]:
    """Files that are missing, changed, or not listed."""
    for entry in listed["files"]:
        found = file_sha256(manifest.locate(folder, entry["path"]))
        if found is None:
            yield Problem(
                entry["path"], None, "file", "found none, expected the file that the manifest lists"
            )
        elif found != entry["sha256"]:
            message = f"found {found[:12]}…, expected {entry['sha256'][:12]}… as the manifest lists"
            yield Problem(entry["path"], None, "hash", message)
    known = {entry["path"] for entry in listed["files"]} | manifest.outgoing(folder)
    for path in sorted((folder / "data").glob("*")):
        name = f"data/{path.name}"
        if name not in known and not path.name.startswith("."):
            yield Problem(name, None, "file", "found a file that the manifest does not list, expected none")


def _contents(folder: Path, listed: dict[str, Any], damaged: set[str]) -> Iterator[Problem]:
    info = json.loads(manifest.locate(folder, "meta/info.json").read_bytes())
    episodes = pq.read_table(manifest.locate(folder, "meta/episodes.parquet"))
    yield from _metadata(listed, info, episodes)
    shard_of = episodes["shard"].to_numpy()
    floats = [c["name"] for c in info["columns"] if c["dtype"].startswith("float")]
    parts: list[tuple[dict[str, Any], Moments]] = []
    for number, shard in enumerate(listed["shards"]):
        if shard["path"] in damaged:
            continue
        table, problems = _readable(manifest.locate(folder, shard["path"]), shard, info["columns"])
        if table is not None:
            own = episodes.filter(pa.array(shard_of == number))
            problems += check_shard(table, shard, info, own)
        yield from problems
        if table is not None and not problems:
            parts.append((shard, moments(np.stack([table[name].to_numpy() for name in floats]))))
    if len(parts) == len(listed["shards"]):
        stats = json.loads(manifest.locate(folder, "meta/stats.json").read_bytes())
        yield from _statistics(stats, floats, parts)


def _metadata(listed: dict[str, Any], info: dict[str, Any], episodes: pa.Table) -> Iterator[Problem]:
    """Counts and the content root, from the table of episodes."""
    lengths = episodes["length"].to_numpy()
    counts = {"rows": int(lengths.sum()), "episodes": len(lengths), "shards": len(listed["shards"])}
    for name, count in counts.items():
        if info["counts"][name] != count:
            yield Problem(
                "meta/info.json", None, "counts", f"{name}: found {info['counts'][name]}, expected {count}"
            )
    cells = [bytes.fromhex(cell) for cell in episodes["cell"].to_pylist()]
    digests = episodes["digest"].to_pylist()
    described = [(column["name"], column["dtype"]) for column in info["columns"]]
    root = content_root(described, zip(cells, episodes["index"].to_pylist(), digests, strict=True))
    if root != listed["content_root"]:
        yield Problem(manifest.PATH, None, "content root", f"found {listed['content_root']}, expected {root}")


def _readable(
    path: Path, shard: dict[str, Any], described: list[dict[str, Any]]
) -> tuple[pa.Table | None, list[Problem]]:
    """The table of a shard that has the columns it should have, or why there is none."""
    try:
        table = pq.read_table(path, page_checksum_verification=True)
    except (OSError, pa.ArrowException) as error:
        reason = f"cannot be read: {str(error).splitlines()[0]}"
        return None, [Problem(shard["path"], None, "parquet", reason)]
    found = [(field.name, _plain_type(field.type)) for field in table.schema]
    expected = [(column["name"], column["dtype"]) for column in described]
    if found != expected:
        pairs = zip_longest(found, expected)
        wrong, right = next((f, e) for f, e in pairs if f != e)
        return None, [Problem(shard["path"], None, "schema", f"found column {wrong}, expected {right}")]
    missing = [Problem(shard["path"], row, "nulls", message) for row, message in nulls(table)]
    return (None if missing else table), missing


def _statistics(
    stats: dict[str, Any], names: list[str], parts: list[tuple[dict[str, Any], Moments]]
) -> Iterator[Problem]:
    """Counts, means, deviations and ranges in stats.json, over all rows and over each split."""
    for split, listed in {None: stats["all"], **stats["splits"]}.items():
        own = [part for shard, part in parts if split is None or split in shard["splits"]]
        total = reduce(merged, own)
        for i, name in enumerate(names):
            std = np.sqrt(total.squares[i] / total.rows)
            expected = {"count": total.rows, "mean": total.mean[i], "std": std, "min": total.low[i]}
            expected["max"] = total.high[i]
            for key, value in expected.items():
                found = listed[name][key]
                if np.isfinite(value) and not np.isclose(found, value, rtol=1e-9, atol=1e-9):
                    where = name if split is None else f"split {split}: {name}"
                    message = f"{where}: {key}: found {found}, expected {value}"
                    yield Problem("meta/stats.json", None, "statistics", message)


def _plain_type(kind: pa.DataType) -> str:
    """The type of a column as info.json names it."""
    if pa.types.is_dictionary(kind):
        return "string"
    return {"float": "float32", "double": "float64"}.get(str(kind), str(kind))
