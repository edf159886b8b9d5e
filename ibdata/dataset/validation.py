"""Whether a dataset is what its manifest says: files, metadata, and every rule of its rows."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import zip_longest
from pathlib import Path
from typing import Any

import pyarrow as pa

from ibdata.dataset import manifest, parquet, shape, storage
from ibdata.dataset.check import THREADS, check_shard
from ibdata.dataset.consistency import Part, check_metadata, check_statistics, moments_of, part_of, ranges_of
from ibdata.dataset.episodes import read_episodes
from ibdata.dataset.files import file_sha256
from ibdata.dataset.frame import frame_of
from ibdata.dataset.metadata import as_json
from ibdata.dataset.rules import Problem, nulls
from ibdata.errors import DatasetError

METADATA: dict[str, Callable[[Path, int], Any]] = {
    "meta/info.json": lambda folder, _: manifest.read_json(folder, "meta/info.json", shape.Info),
    "meta/episodes.parquet": read_episodes,
    "meta/stats.json": lambda folder, _: manifest.read_json(folder, "meta/stats.json", shape.Stats),
}


def validate(folder: str | os.PathLike[str], quick: bool = False) -> list[Problem]:
    """Every problem of the dataset in a folder or at a URL; none means that it is whole.

    Runs no code of the dataset. At a URL, files that are not listed are not looked for.

    quick compares the SHA-256 of every file only. Else also: schema, no nulls, finite, bounds, order,
    flags, continuity, reward identity, setpoints, episode digests, content root, counts, statistics.
    """
    folder = storage.folder_of(folder)
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
    if damaged & set(METADATA):
        return problems
    return [*problems, *_contents(folder, listed, damaged)]


def check_files(folder: Path, listed: dict[str, Any]) -> Iterator[Problem]:
    """Files that are missing, changed, or not listed."""
    paths = [manifest.locate(folder, entry["path"]) for entry in listed["files"]]
    with ThreadPoolExecutor(THREADS) as threads:  # hashing lets go of Python's lock
        hashes = list(threads.map(file_sha256, paths))
    for entry, found in zip(listed["files"], hashes, strict=True):
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
    read: dict[str, Any] = {}
    for path, reader in METADATA.items():
        try:
            read[path] = reader(folder, len(listed["shards"]))
        except DatasetError as error:
            yield Problem(path, None, "metadata", str(error))
    if len(read) < len(METADATA):
        return
    info, episodes, stats = read.values()
    yield from check_metadata(listed, info, episodes, stats)
    shard_of = episodes["shard"].to_numpy()
    parts: list[Part] = []
    for number, shard in enumerate(listed["shards"]):
        if shard["path"] in damaged:
            continue
        own = episodes.filter(pa.array(shard_of == number))
        table, wrong = _readable(manifest.locate(folder, shard["path"]), shard, info["columns"])
        if table is not None:
            frame = frame_of(table, info["columns"])
            whole = moments_of(frame)
            wrong += check_shard(table, frame, shard, info, own, ranges_of(info, whole))
            if not wrong:
                parts.append(part_of(frame, whole, shard, own))
        yield from wrong
    if len(parts) == len(listed["shards"]):
        yield from check_statistics(stats, info, parts)


def _readable(
    path: Path, shard: dict[str, Any], described: list[dict[str, Any]]
) -> tuple[pa.Table | None, list[Problem]]:
    """The table of a shard that has the columns it should have, or why there is none."""
    try:
        table = parquet.read(path)
    except DatasetError as error:
        reason = str(error).removeprefix(f"{path}: ").replace(", see ibdata validate", "")
        return None, [Problem(shard["path"], None, "parquet", reason)]
    found = [(field.name, _plain_type(field.type)) for field in table.schema]
    expected = [(column["name"], column["dtype"]) for column in described]
    if found != expected:
        pairs = zip_longest(found, expected)
        wrong, right = next((f, e) for f, e in pairs if f != e)
        return None, [Problem(shard["path"], None, "schema", f"found column {wrong}, expected {right}")]
    missing = [Problem(shard["path"], row, "nulls", message) for row, message in nulls(table)]
    return (None if missing else table), missing


def _plain_type(kind: pa.DataType) -> str:
    """The type of a column as info.json names it."""
    if pa.types.is_dictionary(kind):
        return "string"
    return {"float": "float32", "double": "float64"}.get(str(kind), str(kind))
