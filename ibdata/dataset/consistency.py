"""Whether the files of `meta/` agree with the manifest, with each other, and with the rows."""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from ibdata.dataset import manifest
from ibdata.dataset.digest import content_root
from ibdata.dataset.frame import Frame, floats_of
from ibdata.dataset.rules import Problem
from ibdata.dataset.statistics import Moments, joined, merged, moments


class Part(NamedTuple):
    """The moments of a shard's rows, and of those in each split."""

    whole: Moments
    splits: dict[str, Moments]


def check_metadata(
    listed: dict[str, Any], info: dict[str, Any], episodes: pa.Table, stats: dict[str, Any]
) -> Iterator[Problem]:
    """Counts, splits, and the content root."""
    lengths = episodes["length"].to_numpy()
    counts = {"rows": int(lengths.sum()), "episodes": len(lengths), "shards": len(listed["shards"])}
    for name, count in counts.items():
        if info["counts"][name] != count:
            yield Problem(
                "meta/info.json", None, "counts", f"{name}: found {info['counts'][name]}, expected {count}"
            )
    if listed["rows"] != counts["rows"]:
        message = f"rows: found {listed['rows']}, expected {counts['rows']}"
        yield Problem(manifest.PATH, None, "counts", message)
    yield from _splits(listed, info, episodes, stats)
    yield from _root(listed, info, episodes)


def _splits(
    listed: dict[str, Any], info: dict[str, Any], episodes: pa.Table, stats: dict[str, Any]
) -> Iterator[Problem]:
    counted: dict[str, list[int]] = {name: [0, 0] for name in info["splits"]}
    lengths = episodes["length"].to_pylist()
    for names, length in zip(episodes["splits"].to_pylist(), lengths, strict=True):
        for name in names:
            counted.setdefault(name, [0, 0])
            counted[name][0] += 1
            counted[name][1] += length
    for name, (count, rows) in counted.items():
        split = info["splits"].get(name)
        if split is None or (split["episodes"], split["rows"]) != (count, rows):
            found = "none" if split is None else f"{split['episodes']} episodes of {split['rows']} rows"
            message = f"split {name}: found {found}, expected {count} episodes of {rows} rows"
            yield Problem("meta/info.json", None, "splits", message)
            continue
        files = [shard["path"] for shard in listed["shards"] if name in shard["splits"]]
        if split["files"] is not None and split["files"] != files:
            message = f"split {name}: found other files than the manifest has for it"
            yield Problem("meta/info.json", None, "splits", message)
    if set(stats["splits"]) != set(info["splits"]):
        message = f"found splits {sorted(stats['splits'])}, expected {sorted(info['splits'])}"
        yield Problem("meta/stats.json", None, "splits", message)


def _root(listed: dict[str, Any], info: dict[str, Any], episodes: pa.Table) -> Iterator[Problem]:
    described = [(column["name"], column["dtype"]) for column in info["columns"]]
    columns = (episodes[name].to_pylist() for name in ("cell", "index", "digest"))
    try:
        addressed = [(bytes.fromhex(cell), i, digest) for cell, i, digest in zip(*columns, strict=True)]
        root = content_root(described, addressed)
    except (ValueError, OverflowError):
        message = "found a cell or index that is none, expected a digest and a number from 0"
        yield Problem("meta/episodes.parquet", None, "shape", message)
        return
    if root != listed["content_root"]:
        yield Problem(manifest.PATH, None, "content root", f"found {listed['content_root']}, expected {root}")


def moments_of(frame: Frame) -> Moments:
    """The moments of the columns of floats of a shard."""
    return joined([moments(values) for values in floats_of(frame)])


def ranges_of(info: dict[str, Any], whole: Moments) -> dict[str, tuple[float, float]]:
    """The least and the greatest value of each column of floats, given the moments, where all are finite."""
    return {
        name: (float(whole.low[i]), float(whole.high[i]))
        for i, name in enumerate(_floats(info))
        if np.isfinite(whole.squares[i])
    }


def part_of(frame: Frame, whole: Moments, shard: dict[str, Any], episodes: pa.Table) -> Part:
    """The moments of a shard, which are known, and of the rows of each split in it."""
    of = {name: whole for name in shard["splits"]}
    lengths, names = episodes["length"].to_numpy(), episodes["splits"].to_pylist()
    for name in {name for own in names for name in own} - of.keys():
        rows = np.repeat([name in own for own in names], lengths)
        taken = [moments(np.ascontiguousarray(values[:, rows])) for values in floats_of(frame)]
        of[name] = joined(taken)
    return Part(whole, of)


def check_statistics(stats: dict[str, Any], info: dict[str, Any], parts: list[Part]) -> Iterator[Problem]:
    """Counts, means, deviations and ranges in stats.json, over all rows and over each split."""
    for split, listed in {None: stats["all"], **stats["splits"]}.items():
        own = [part.whole if split is None else part.splits[split] for part in parts
               if split is None or split in part.splits]  # fmt: skip
        if not own:
            yield Problem("meta/stats.json", None, "statistics", f"split {split}: found no rows of it")
            continue
        total = reduce(merged, own)
        for i, name in enumerate(_floats(info)):
            where = name if split is None else f"split {split}: {name}"
            if name not in listed:
                yield Problem("meta/stats.json", None, "statistics", f"{where}: found none, expected some")
                continue
            yield from _compared(listed[name], total, i, where)


def _compared(listed: dict[str, Any], total: Moments, i: int, where: str) -> Iterator[Problem]:
    std = np.sqrt(total.squares[i] / total.rows)
    expected = {"count": total.rows, "mean": total.mean[i], "std": std, "min": total.low[i]}
    expected["max"] = total.high[i]
    for key, value in expected.items():
        found = listed[key]
        if np.isfinite(value) and (found is None or not np.isclose(found, value, rtol=1e-9, atol=1e-9)):
            message = f"{where}: {key}: found {found}, expected {value}"
            yield Problem("meta/stats.json", None, "statistics", message)


def _floats(info: dict[str, Any]) -> list[str]:
    return [c["name"] for c in info["columns"] if c["dtype"].startswith("float")]
