"""The description of a finished dataset: manifest, columns, splits, episodes and returns."""

from __future__ import annotations

import os
from functools import cached_property
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from ibdata.arguments import public
from ibdata.dataset import manifest
from ibdata.dataset.episodes import read_episodes
from ibdata.dataset.models import Info, SplitEntry
from ibdata.dataset.returns import Returns, behaviour_returns
from ibdata.dataset.selection import Mask, Policy, Setpoint, Split, known_of, selected
from ibdata.dataset.splits import Splits, read_splits, runs_of, with_later
from ibdata.dataset.tabular import Table, as_html
from ibdata.errors import UsageError, printable
from ibdata.numerics.naming import counted
from ibdata.system.storage import existing, storage

if TYPE_CHECKING:
    from pathlib import Path

    import pandas as pd


class Contents:
    """What the files in `meta/` say of a dataset; `Dataset` adds the rows."""

    @public
    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.storage = storage(existing(path))
        self.place = self.storage.name
        self.manifest_model = manifest.read(self.storage)
        self._split_entries: tuple[Any, dict[str, SplitEntry]] | None = None

    def __repr__(self) -> str:
        n = self.info_model.counts
        size = f"{counted(n.rows, 'row')}, {counted(n.episodes, 'episode')}"
        return f"<ibdata.Dataset {printable(self.place)}: {size}>"

    def _repr_html_(self) -> str:
        info, episodes = self.info_model, self.episode_table
        row = {
            "dataset": info.name,
            "rows": info.counts.rows,
            "episodes": info.counts.episodes,
            "policies": episodes["policy"].unique().to_pylist(),
            "setpoints": episodes["setpoint"].unique().to_pylist(),
            "content root": f"{self.content_root[:12]}…",
            "in": self.place,
        }
        return as_html([Table(list(row), [list(row.values())]), *self.splits.tables()])

    def __fspath__(self) -> str:
        return str(self.path)

    def __len__(self) -> int:
        return self.manifest_model.rows

    @property
    def path(self) -> Path:
        """The folder. Raises UsageError for a dataset at a URL."""
        return self.storage.path

    @property
    def content_root(self) -> str:
        """The hex SHA-256 that identifies the content; it does not depend on files or encodings."""
        return self.manifest_model.content_root

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """meta/manifest.json: experiments, shards, files with their SHA-256, content root, versions."""
        return self.manifest_model.plain()

    @cached_property
    def info(self) -> dict[str, Any]:
        """meta/dataset.json: columns with roles, units and bounds; counts."""
        return self.info_model.plain()

    @cached_property
    def info_model(self) -> Info:
        """`info` as a model."""
        return manifest.read_json(self.storage, self.manifest_model, "meta/dataset.json", Info)

    @property
    def splits(self) -> Splits:
        """For each split its numbers of episodes and rows, and whether it is declared: of whole files."""
        keys = {"episodes", "rows", "declared"}
        return Splits({name: entry.model_dump(include=keys) for name, entry in self.split_entries.items()})

    @property
    def split_entries(self) -> dict[str, SplitEntry]:
        """meta/splits.json as models. It is read again when the file is another one than before."""
        stamp = self.storage.stamp(manifest.SPLITS)
        known = self._split_entries
        if known is None or known[0] != stamp:
            known = self._split_entries = stamp, read_splits(self.storage, self.manifest_model)
        return known[1]

    @property
    def episodes(self) -> pd.DataFrame:
        """One row per episode: cell, index, setpoint, policy, splits, length, return, place of its rows."""
        table = with_later(self.episode_table, self.split_entries)
        frame: pd.DataFrame = table.to_pandas(ignore_metadata=True)
        return frame

    @cached_property
    def episode_table(self) -> pa.Table:
        """meta/episodes.parquet: `episodes`, but without later splits."""
        return read_episodes(self.storage, self.manifest_model)

    @property
    def digests(self) -> list[bytes]:
        """The content digest of each episode, in order."""
        digests: list[bytes] = self.episode_table["digest"].to_pylist()
        return digests

    @public
    def returns(self) -> Returns:
        """The undiscounted returns of the behaviour, by policy and setpoint.

        Returns:
            `results`, a list of dicts with policy, setpoint, episodes, steps, mean_return, standard_error,
            interval, mean_reward (per step) and score; and `scale`, the meaning of the scores. Scores exist
            for episodes of 1000 steps under a published variant, at the setpoints 0, 5 … 100, from the starts
            default, uniform and {burn_in: [15, 64]}; for others, the score is None.
        """
        return behaviour_returns(self.episode_table, self.info_model)

    @public
    def selected(self, split: Split = None, setpoint: Setpoint = None, policy: Policy = None) -> Mask:
        """Whether each episode is in a split, at these setpoints and of these policies.

        Raises UsageError if the dataset has no such split, setpoint or policy.
        """
        runs = None if split is None else runs_of(split, self.split_entry(split), self.manifest_model)
        return selected(self.episode_table, runs, setpoint, policy)

    @public
    def split_entry(self, split: str) -> SplitEntry:
        """The description of a split. Raises UsageError if the dataset does not have it."""
        if not self.split_entries:
            raise UsageError(f"split: found {split!r}, expected no split: the dataset declares no splits")
        [name] = known_of("split", split, list(self.split_entries))
        return self.split_entries[name]
