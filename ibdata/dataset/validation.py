"""Whether a dataset is what its manifest says: files, metadata, and every rule of its rows."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ibdata.dataset import manifest
from ibdata.dataset.digest import content_root, episode_digests, table_runs
from ibdata.dataset.files import file_sha256
from ibdata.dataset.rules import RULES, Rows, nulls
from ibdata.errors import DatasetError


class Problem(NamedTuple):
    """One broken rule: the file, the row in it if there is one, the rule, what was found and expected."""

    path: str
    row: int | None
    rule: str
    message: str

    def __str__(self) -> str:
        place = self.path if self.row is None else f"{self.path}: row {self.row}"
        return f"{place}: {self.rule}: {self.message}"


def validate(folder: Path, quick: bool = False) -> list[Problem]:
    """Every problem of the dataset in a folder; none means that it is whole. Runs no code of the dataset.

    quick compares the SHA-256 of every file only. Else also: schema, no nulls, finite, bounds, order,
    flags, continuity, reward identity, setpoints, episode digests, content root, counts, statistics.
    """
    try:
        listed = manifest.read(folder)
    except DatasetError as error:
        return [Problem(manifest.PATH, None, "manifest", str(error))]
    problems = list(_files(folder, listed))
    if quick:
        return problems
    damaged = {problem.path for problem in problems}
    if damaged & set(manifest.METADATA):
        return problems
    return [*problems, *_contents(folder, listed, damaged)]


def _files(folder: Path, listed: dict[str, Any]) -> Iterator[Problem]:
    """Files that are missing, changed, or not listed."""
    for entry in listed["files"]:
        path = manifest.locate(folder, entry["path"])
        if path.is_symlink() or not path.is_file():
            yield Problem(
                entry["path"], None, "file", "found none, expected the file that the manifest lists"
            )
        elif file_sha256(path) != entry["sha256"]:
            yield Problem(
                entry["path"],
                None,
                "hash",
                f"found other content than the manifest lists ({entry['sha256'][:12]}…)",
            )
    known = {entry["path"] for entry in listed["files"]}
    for path in sorted((folder / "data").glob("*")):
        name = f"data/{path.name}"
        if name not in known and not path.name.startswith("."):
            yield Problem(name, None, "file", "found a file that the manifest does not list, expected none")


def _contents(folder: Path, listed: dict[str, Any], damaged: set[str]) -> Iterator[Problem]:
    info = json.loads(manifest.locate(folder, "meta/info.json").read_bytes())
    episodes = pq.read_table(manifest.locate(folder, "meta/episodes.parquet"))
    yield from _metadata(listed, info, episodes)
    shard_of = episodes["shard"].to_numpy()
    for number, shard in enumerate(listed["shards"]):
        if shard["path"] not in damaged:
            own = episodes.filter(pa.array(shard_of == number))
            yield from _shard(manifest.locate(folder, shard["path"]), shard, info, own)


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


def _shard(path: Path, shard: dict[str, Any], info: dict[str, Any], episodes: pa.Table) -> Iterator[Problem]:
    described = info["columns"]
    try:
        table = pq.read_table(path, page_checksum_verification=True)
    except (OSError, pa.ArrowException) as error:
        yield Problem(shard["path"], None, "parquet", f"cannot be read: {str(error).splitlines()[0]}")
        return
    found = [(field.name, _plain_type(field.type)) for field in table.schema]
    expected = [(column["name"], column["dtype"]) for column in described]
    if found != expected:
        wrong = next(
            (pair for pair in zip(found, expected, strict=False) if pair[0] != pair[1]), (found, expected)
        )
        yield Problem(shard["path"], None, "schema", f"found {wrong[0]}, expected {wrong[1]}")
        return
    lengths = episodes["length"].to_numpy()
    if table.num_rows != lengths.sum() or table.num_rows != shard["rows"]:
        yield Problem(
            shard["path"],
            None,
            "rows",
            f"found {table.num_rows}, expected {shard['rows']} rows of whole episodes",
        )
        return
    missing = [Problem(shard["path"], row, "nulls", message) for row, message in nulls(table)]
    yield from missing
    if missing:
        return
    rows = Rows(
        {c["name"]: table[c["name"]].to_numpy() for c in described if c["dtype"] != "string"},
        described,
        np.cumsum(lengths) - lengths,
        lengths,
        episodes["episode"].to_numpy(),
        episodes["setpoint"].to_numpy(),
        info["drifting"],
    )
    for name, rule in RULES.items():
        for row, message in rule(rows):
            yield Problem(shard["path"], row, name, message)
    yield from _digests(shard, table, described, episodes, rows)


def _digests(
    shard: dict[str, Any], table: pa.Table, described: list[dict[str, Any]], episodes: pa.Table, rows: Rows
) -> Iterator[Problem]:
    """Labels, digests and returns of the episodes of a shard."""
    labels = np.repeat(np.array(episodes["policy"].to_pylist(), dtype=object), rows.lengths)
    policy = np.array(table["policy"].to_pylist(), dtype=object)
    if (labels != policy).any():
        row = int(np.argmax(labels != policy))
        yield Problem(shard["path"], row, "policy", f"found {policy[row]}, expected {labels[row]}")
        return
    first_rows = rows.starts.tolist()
    digests = episode_digests(table_runs(table, described, first_rows), rows.lengths.tolist())
    for start, digest, expected in zip(first_rows, digests, episodes["digest"].to_pylist(), strict=True):
        if digest != expected:
            yield Problem(shard["path"], start, "digest", "found other content than episodes.parquet lists")
    if hashlib.sha256(b"".join(digests)).hexdigest() != shard["content"]:
        yield Problem(shard["path"], None, "digest", "found other content than the manifest lists")
    returns = np.add.reduceat(rows.columns["reward"].astype(np.float64), rows.starts)
    wrong = ~np.isclose(returns, episodes["return"].to_numpy(), rtol=1e-9, atol=1e-9)
    if wrong.any():
        row = int(rows.starts[np.argmax(wrong)])
        yield Problem(
            shard["path"], row, "return", "found another sum of rewards than episodes.parquet lists"
        )


def _plain_type(kind: pa.DataType) -> str:
    """The type of a column as info.json names it."""
    if pa.types.is_dictionary(kind):
        return "string"
    return {"float": "float32", "double": "float64"}.get(str(kind), str(kind))
