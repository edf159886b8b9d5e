"""Compare two datasets: experiments, counts, columns, and the first episode that differs."""

from __future__ import annotations

from operator import itemgetter
from typing import Any

import pyarrow as pa

from ibdata.arguments import public
from ibdata.dataset.reader import Dataset, Place, opened


@public
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
    first, second = opened(a), opened(b)
    if first.content_root == second.content_root:
        return []
    lines = [f"content root: {first.content_root[:12]}… and {second.content_root[:12]}…"]
    ours, theirs = first.stored.manifest.experiments, second.stored.manifest.experiments
    if len(ours) != len(theirs):
        lines.append(f"experiments: {len(ours)} and {len(theirs)}")
    for i, (one, other) in enumerate(zip(ours, theirs, strict=False)):
        lines += _options(one, other, "experiment" if len(ours) == 1 else f"experiments.{i}")
    for key in ("rows", "episodes", "steps", "cells"):
        one, other = getattr(first.stored.info.counts, key), getattr(second.stored.info.counts, key)
        if one != other:
            lines.append(f"{key}: {one} and {other}")
    types, others = ({c.name: c.dtype for c in x.stored.info.columns} for x in (first, second))
    for name in dict.fromkeys([*types, *others]):
        if types.get(name) != others.get(name):
            lines.append(f"column {name}: {types.get(name, 'none')} and {others.get(name, 'none')}")
    return [*lines, *_episodes(first, second, [name for name in types if name in others])]


def _options(a: Any, b: Any, key: str) -> list[str]:
    """One line for each option that differs, with its path."""
    if isinstance(a, dict) and isinstance(b, dict):
        names = dict.fromkeys([*a, *b])
        return [line for k in names for line in _options(a.get(k), b.get(k), f"{key}.{k}")]
    return [] if a == b else [f"{key}: {a} and {b}"]


def _episodes(a: Dataset, b: Dataset, names: list[str]) -> list[str]:
    """Lines about the episodes that only one has, and about the first episode that differs."""
    ours, theirs = _by_address(a), _by_address(b)
    lines: list[str] = []
    for addresses, other, which in ((ours, theirs, "first"), (theirs, ours, "second")):
        only = sum(len(addresses[address]) for address in addresses.keys() - other.keys())
        if only:
            lines.append(f"episodes with a cell and index that only the {which} has: {only}")
    differing: list[tuple[int, int]] = []
    for address in ours.keys() & theirs.keys():
        one, another = ours[address], theirs[address]
        only_ours = [one[digest] for digest in one if digest not in another]
        only_theirs = [another[digest] for digest in another if digest not in one]
        differing += zip(only_ours, only_theirs, strict=False)
    if differing:
        mine, other_one = min(differing)
        difference = _first_difference(_rows(a, mine, names), _rows(b, other_one, names))
        if difference is not None:
            lines.append(f"episode {mine} and {other_one}: {difference}")
    return lines


def _by_address(dataset: Dataset) -> dict[tuple[str, int], dict[bytes, int]]:
    """Map each cell and index to its episodes by digest. A merged dataset may have one for each seed."""
    columns = (dataset.stored.episodes[name].to_pylist() for name in ("cell", "index", "digest", "episode"))
    episodes: dict[tuple[str, int], dict[bytes, int]] = {}
    for cell, index, digest, episode in zip(*columns, strict=True):
        episodes.setdefault((cell, index), {})[digest] = episode
    return episodes


def _rows(dataset: Dataset, episode: int, names: list[str]) -> pa.Table:
    table = dataset.stored.episodes
    shard, start, stop = (table[name][episode].as_py() for name in ("shard", "row_start", "row_stop"))
    return pa.Table.from_batches(dataset.stored.batches(shard, names, stop - start, start, stop))


def _first_difference(a: pa.Table, b: pa.Table) -> str | None:
    """Describe the first step at which a column differs; None if there is none."""
    differences: list[tuple[int, str, Any, Any]] = []
    for name in a.column_names:
        for step, (x, y) in enumerate(zip(a[name].to_pylist(), b[name].to_pylist(), strict=False)):
            if name != "episode" and x != y and not (x != x and y != y):  # two NaN are equal
                differences.append((step, name, x, y))
                break
    if not differences:
        return None
    step, name, x, y = min(differences, key=itemgetter(0))
    return f"step {step}: {name}: {x} and {y}"
