"""The splits of a dataset, as meta/splits.json lists them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from ibdata.dataset.models import Manifest, SplitEntry
from ibdata.dataset.tabular import Table, Tabular


class Splits(Tabular, dict[str, dict[str, Any]]):
    """The splits of a dataset: a dict by name that shows as a table.

    Each is a dict of `episodes` and `rows`, two numbers, and `declared`: whether it is made of whole files.
    """

    def tables(self) -> list[Table]:
        """The splits, a row each; later ones are labels of episodes."""
        rows = [
            (name, split["episodes"], split["rows"], "whole files" if split["declared"] else "labels")
            for name, split in self.items()
        ]
        return [Table(("split", "episodes", "rows", "kind"), rows, () if rows else ["no splits"])]


def refuse_misfits(entries: Mapping[str, SplitEntry], manifest: Manifest) -> None:
    """Raise ValueError if declared splits are not those of the shards, or later ones no runs of episodes."""
    episodes, rows = Counter[str](), Counter[str]()
    for shard in manifest.shards:
        first, stop = shard.episodes
        for name in shard.splits:
            episodes[name] += stop - first
            rows[name] += shard.rows
    for name in episodes.keys() | entries.keys():
        entry = entries.get(name)
        if name in episodes and entry != SplitEntry(episodes=episodes[name], rows=rows[name], declared=True):
            raise ValueError(f"{name}: found another split than the manifest lists")
        if name not in episodes and (entry is None or entry.declared or not _holds(entry, manifest)):
            raise ValueError(f"{name}: found no runs of the episodes of the dataset")


def _holds(entry: SplitEntry, manifest: Manifest) -> bool:
    """Whether a later split has as many episodes as it says, in order, and all are in the dataset."""
    bounds = [bound for run in entry.runs for bound in run]
    count = sum(stop - first for first, stop in entry.runs)
    return (
        bounds == sorted(bounds)
        and 0 < entry.episodes == count
        and bounds[-1] <= manifest.shards[-1].episodes[1]
    )


def with_later(episodes: pa.Table, entries: Mapping[str, SplitEntry]) -> pa.Table:
    """The table of episodes with the later splits of each episode behind the declared ones."""
    later = {name: entry.runs for name, entry in entries.items() if not entry.declared}
    if not later:
        return episodes
    column = episodes["splits"].combine_chunks()
    owners = [np.repeat(np.arange(len(column)), np.diff(column.offsets.to_numpy()))]
    names = [column.flatten()]
    for name, runs in later.items():
        numbers = np.concatenate([np.arange(first, stop) for first, stop in runs])
        owners.append(numbers)
        names.append(pa.repeat(name, len(numbers)))
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    ends = np.cumsum(np.bincount(owner, minlength=len(column)))
    offsets = pa.array(np.concatenate([[0], ends]), pa.int32())
    lists = pa.ListArray.from_arrays(offsets, pa.concat_arrays(names).take(pa.array(order)))
    return episodes.set_column(episodes.column_names.index("splits"), "splits", lists)
