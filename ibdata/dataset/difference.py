"""Compare two datasets: experiments, counts, columns, and the first episode that differs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from ibdata.dataset.reader import Dataset, Place, opened


def difference(a: Place, b: Place) -> list[str]:
    """Compare the content of two datasets.

    Args:
        a: One dataset, or its folder.
        b: The other.

    Returns:
        One line per difference: options of the experiments, counts, columns, episodes that only one has, and
        the first step and column at which an episode differs. Empty if the content is the same.

    Raises:
        DatasetError: A file is missing or damaged, or a folder holds no dataset.
    """
    a, b = map(opened, (a, b))
    if a.content_root == b.content_root:
        return []
    lines = [f"content root: {a.content_root[:12]}… and {b.content_root[:12]}…"]
    ours, theirs = (x.manifest_model.experiments for x in (a, b))
    if len(ours) != len(theirs):
        lines.append(f"experiments: {len(ours)} and {len(theirs)}")
    for i, pair in enumerate(zip(ours, theirs, strict=False)):
        lines += _experiments(*pair, "experiment" if len(ours) == 1 else f"experiments.{i}")
    for key in ("rows", "episodes", "steps", "cells"):
        one, other = (getattr(x.info_model.counts, key) for x in (a, b))
        if one != other:
            lines.append(f"{key}: {one} and {other}")
    types = [{c.name: c.dtype for c in x.info_model.columns} for x in (a, b)]
    for name in dict.fromkeys([*types[0], *types[1]]):
        if types[0].get(name) != types[1].get(name):
            lines.append(f"column {name}: {types[0].get(name, 'none')} and {types[1].get(name, 'none')}")
    return [*lines, *_episodes(a, b, [name for name in types[0] if name in types[1]])]


def _experiments(a: Any, b: Any, key: str) -> list[str]:
    """One line for each option that differs, with its path."""
    if isinstance(a, dict) and isinstance(b, dict):
        names = dict.fromkeys([*a, *b])
        return [line for k in names for line in _experiments(a.get(k), b.get(k), f"{key}.{k}")]
    return [] if a == b else [f"{key}: {a} and {b}"]


def _episodes(a: Dataset, b: Dataset, names: list[str]) -> list[str]:
    """Lines about the episodes that only one has, and about the first episode that differs."""
    of = [_by_address(x) for x in (a, b)]
    lines: list[str] = []
    differing: list[tuple[int, int]] = []
    for x, y, which in ((of[0], of[1], "first"), (of[1], of[0], "second")):
        only = sum(len(x[address]) for address in x.keys() - y.keys())
        if only:
            lines.append(f"episodes with a cell and index that only the {which} has: {only}")
    for address in of[0].keys() & of[1].keys() if of[0] != of[1] else ():
        ours, theirs = of[0][address], of[1][address]
        only_ours = [ours[digest] for digest in ours if digest not in theirs]
        only_theirs = [theirs[digest] for digest in theirs if digest not in ours]
        differing += list(zip(only_ours, only_theirs, strict=False))
    for mine, other in sorted(differing)[:1]:
        found = _first_difference(_rows(a, mine, names), _rows(b, other, names))
        lines.append(f"episode {mine} and {other}: {found}")
    return lines


def _by_address(dataset: Dataset) -> dict[tuple[str, int], dict[bytes, int]]:
    """Map each cell and index to its episodes by digest. A merged dataset may have one for each seed."""
    columns = ("cell", "index", "digest", "episode")
    table = dataset.episode_table
    found: dict[tuple[str, int], dict[bytes, int]] = {}
    for cell, index, digest, episode in zip(*(table[name].to_pylist() for name in columns), strict=True):
        found.setdefault((cell, index), {})[digest] = episode
    return found


def _rows(dataset: Dataset, episode: int, names: list[str]) -> dict[str, list[Any]]:
    shard, start, stop = (
        dataset.episode_table[name][episode].as_py() for name in ("shard", "row_start", "row_stop")
    )
    part = pa.Table.from_batches(dataset.shard_batches(shard, names, stop - start, start, stop))
    return {name: part[name].to_pylist() for name in names if name != "episode"}


def _first_difference(a: dict[str, list[Any]], b: dict[str, list[Any]]) -> str | None:
    """Describe the first step at which a column differs; None if there is none."""
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
