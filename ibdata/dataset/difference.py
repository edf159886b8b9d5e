"""How two datasets differ: experiment, columns, counts, and the first episode and column."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow.parquet as pq

from ibdata.dataset import manifest
from ibdata.dataset.reader import Dataset


def difference(a: Dataset, b: Dataset) -> list[str]:
    """What is different, a line each; nothing where the content is the same."""
    if a.content_root == b.content_root:
        return []
    lines = [f"content root: {a.content_root[:12]}… and {b.content_root[:12]}…"]
    lines += _experiments(a.manifest["experiment"], b.manifest["experiment"])
    for key in ("rows", "episodes", "steps", "cells"):
        if a.info["counts"][key] != b.info["counts"][key]:
            lines.append(f"{key}: {a.info['counts'][key]} and {b.info['counts'][key]}")
    types = [{c["name"]: c["dtype"] for c in x.info["columns"]} for x in (a, b)]
    for name in dict.fromkeys([*types[0], *types[1]]):
        if types[0].get(name) != types[1].get(name):
            lines.append(f"column {name}: {types[0].get(name, 'none')} and {types[1].get(name, 'none')}")
    return [*lines, *_episodes(a, b, [name for name in types[0] if name in types[1]])]


def _experiments(a: Any, b: Any, key: str = "experiment") -> list[str]:
    """The options that differ, by their path."""
    if isinstance(a, dict) and isinstance(b, dict):
        names = dict.fromkeys([*a, *b])
        return [line for k in names for line in _experiments(a.get(k), b.get(k), f"{key}.{k}")]
    return [] if a == b else [f"{key}: {a} and {b}"]


def _episodes(a: Dataset, b: Dataset, names: list[str]) -> list[str]:
    """Episodes that only one has, and the first column and step of the first that differs."""
    of = [_by_address(x) for x in (a, b)]
    lines = []
    for mine, other, which in ((of[0], of[1], "first"), (of[1], of[0], "second")):
        only = len(mine.keys() - other.keys())
        if only:
            lines.append(f"episodes of cells or indices that only the {which} has: {only}")
    for address, (digest, episode) in of[0].items():
        if address in of[1] and of[1][address][0] != digest:
            found = _first_difference(_rows(a, episode, names), _rows(b, of[1][address][1], names))
            if found:
                lines.append(f"episode {episode} and {of[1][address][1]}: {found}")
                break
    return lines


def _by_address(dataset: Dataset) -> dict[tuple[str, int], tuple[bytes, int]]:
    columns = ["cell", "index", "digest", "episode"]
    table = pq.read_table(manifest.locate(dataset.path, "meta/episodes.parquet"), columns=columns)
    cells, indices, digests, episodes = (table[name].to_pylist() for name in columns)
    return {
        (cell, index): (digest, episode)
        for cell, index, digest, episode in zip(cells, indices, digests, episodes, strict=True)
    }


def _rows(dataset: Dataset, episode: int, names: list[str]) -> dict[str, list[Any]]:
    row = dataset.episodes.iloc[episode]
    shard = dataset.manifest["shards"][int(row["shard"])]["path"]
    table = pq.read_table(manifest.locate(dataset.path, shard), columns=names)
    part = table.slice(int(row["row_start"]), int(row["length"]))
    return {name: part[name].to_pylist() for name in names if name != "episode"}


def _first_difference(a: dict[str, list[Any]], b: dict[str, list[Any]]) -> str | None:
    """The earliest step at which a column differs."""
    found: tuple[int, str] | None = None
    for name in a:
        for step, (x, y) in enumerate(zip(a[name], b[name], strict=False)):
            if x != y and not (isinstance(x, float) and np.isnan(x) and np.isnan(y)):
                found = min(found, (step, name)) if found else (step, name)
                break
    if found is None:
        return None
    step, name = found
    return f"step {step}: {name}: {a[name][step]} and {b[name][step]}"
