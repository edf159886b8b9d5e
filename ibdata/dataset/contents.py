"""The description of a finished dataset: manifest, columns, splits, statistics, episodes and returns."""

from __future__ import annotations

import os
from functools import cached_property
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from ibdata.dataset import manifest
from ibdata.dataset.episodes import read_episodes
from ibdata.dataset.models import Info, Manifest, Stats
from ibdata.dataset.overview import Splits, overview
from ibdata.dataset.returns import Returns, behaviour_returns
from ibdata.dataset.selection import known_of
from ibdata.errors import DatasetError, UsageError, printable
from ibdata.numerics.naming import counted
from ibdata.system import object_store

if TYPE_CHECKING:
    import pandas as pd

TRIES = 5


class Contents:
    """What the files in `meta/` say of a dataset; `Dataset` adds the rows."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = object_store.local_copy(path)
        self.place = object_store.name_of(self.path)
        self.manifest_model: Manifest
        for _ in range(TRIES):  # until manifest and info are of one dataset
            self.manifest_model = manifest.read(self.path)
            try:
                self.info_model  # noqa: B018  # kept
            except manifest.ReplacedError:
                continue
            except DatasetError:
                pass  # `info` raises it again
            break

    def __repr__(self) -> str:
        n = self.info_model.counts
        size = f"{counted(n.rows, 'row')}, {counted(n.episodes, 'episode')}"
        size = f"{counted(n.rows, 'row')}, {counted(n.episodes, 'episode')}"
        return f"<ibdata.Dataset {printable(self.place)}: {size}>"

    def _repr_html_(self) -> str:
        return overview(self)

    def __fspath__(self) -> str:
        return str(self.path)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "url": object_store.url_of(self.path)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        url = state.pop("url")
        self.__dict__.update(state)
        if url is not None:
            self.path = object_store.own_copy(self.path, url)

    def __len__(self) -> int:
        return self.manifest_model.rows

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
        """meta/info.json: columns with roles, units and bounds; counts; splits."""
        return self.info_model.plain()

    @cached_property
    def info_model(self) -> Info:
        """`info` as a model."""
        return manifest.read_json(self.path, self.manifest_model, "meta/info.json", Info)

    @property
    def splits(self) -> Splits:
        """For each split its numbers of episodes and rows, and its files; None for files if it has none."""
        return Splits({name: split.plain() for name, split in self.info_model.splits.items()})

    def statistics(self, split: str | None = None) -> dict[str, Any]:
        """Statistics of the float columns.

        Args:
            split: Only the rows of this split; by default all rows.

        Returns:
            For each column: count, mean, std, min, max, and quantiles by their probability, such as "0.5".

        Raises:
            UsageError: The dataset has no such split.
            DatasetError: meta/stats.json is missing or damaged.
        """
        stats = manifest.read_json(self.path, self.manifest_model, "meta/stats.json", Stats)
        columns = stats.all if split is None else stats.splits[self._known(split)]
        return {name: column.plain() for name, column in columns.items()}

    @property
    def episodes(self) -> pd.DataFrame:
        """One row per episode: cell, index, setpoint, policy, splits, length, return, place of its rows."""
        return self._episode_frame.copy()  # because nobody's changes of it may change what is read

    @cached_property
    def _episode_frame(self) -> pd.DataFrame:
        frame: pd.DataFrame = self.episode_table.to_pandas(ignore_metadata=True)
        return frame

    @property
    def digests(self) -> list[bytes]:
        """The content digest of each episode, in order."""
        digests: list[bytes] = self.episode_table["digest"].to_pylist()
        return digests

    def returns(self) -> Returns:
        """The undiscounted returns of the behaviour, by policy and setpoint.

        Returns:
            `results`, a list of dicts with policy, setpoint, episodes, steps, mean_return, standard_error,
            interval, mean_reward (per step) and score; and `scale`, the meaning of the scores. Scores exist
            for episodes of 1000 steps under a published variant, at the setpoints 0, 5 … 100, from the starts
            default, uniform and {burn_in: [15, 64]}; for others, the score is None.
        """
        return behaviour_returns(self.episode_table, self.info_model)

    @cached_property
    def episode_table(self) -> pa.Table:
        """`episodes` as an Arrow table."""
        return read_episodes(self.path, self.manifest_model)

    def _known(self, split: str) -> str:
        """Return the split. Raises UsageError if the dataset does not have it."""
        if not isinstance(split, str):
            raise UsageError(f"split: found {split!r}, expected the name of one split")
        if not self.splits:
            raise UsageError(f"split: found {split!r}, expected no split: the dataset declares no splits")
        return str(known_of("split", split, list(self.splits))[0])
