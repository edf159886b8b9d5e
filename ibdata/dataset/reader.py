"""Reading a finished dataset: pandas, Arrow, batches, arrays. Nothing of it runs code of the dataset."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from ibdata.dataset import manifest
from ibdata.dataset.history import stacked
from ibdata.dataset.returns import behaviour_returns
from ibdata.errors import DatasetError, UsageError

if TYPE_CHECKING:
    import pandas as pd


class Dataset:
    """A finished dataset in a folder; only what its manifest lists is ever read."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.manifest: dict[str, Any] = manifest.read(self.path)

    def __repr__(self) -> str:
        counts = self.info["counts"]
        return f"<ibdata.Dataset {self.path}: {counts['rows']} rows, {counts['episodes']} episodes>"

    def __len__(self) -> int:
        return int(self.manifest["rows"])

    @property
    def content_root(self) -> str:
        """Hex SHA-256 that names the content, whatever files hold it."""
        return str(self.manifest["content_root"])

    @cached_property
    def info(self) -> dict[str, Any]:
        """meta/info.json: columns with roles, units and bounds; counts; splits."""
        return self._json("meta/info.json")

    def statistics(self, split: str | None = None) -> dict[str, Any]:
        """count, mean, std, min, max and quantiles of each float column, over all rows or a split's."""
        stats = self._json("meta/stats.json")
        columns: dict[str, Any] = stats["all"] if split is None else stats["splits"][self._known(split)]
        return columns

    @cached_property
    def episodes(self) -> pd.DataFrame:
        """A row an episode: cell, index, setpoint, policy, splits, length, return, and where its rows are."""
        frame: pd.DataFrame = self._episodes().to_pandas()
        return frame

    def returns(self) -> dict[str, Any]:
        """Undiscounted returns of the behaviour: by policy and setpoint, with a score where there is a scale.

        `results`: policy, setpoint, episodes, mean_return, standard_error, interval, mean_reward (per step)
        and score. `scale` says what the score is; there is one for 1000 steps from the default start under a
        published variant and constant setpoints, else it is None, as is every score.
        """
        return behaviour_returns(self._episodes(), self.info)

    def _episodes(self) -> pa.Table:
        return _read(manifest.locate(self.path, "meta/episodes.parquet"), None)

    def table(self, columns: Sequence[str] | None = None, split: str | None = None) -> pa.Table:
        """The rows, or those of a split, as an Arrow table.

        Raises UsageError for a column or a split that the dataset does not have.
        """
        names = self._columns(columns)
        return pa.concat_tables([_read(file, names) for file in self._files(split)]).unify_dictionaries()

    def to_pandas(self, columns: Sequence[str] | None = None, split: str | None = None) -> pd.DataFrame:
        """The rows, or those of a split, as a pandas DataFrame. Raises as `table`."""
        frame: pd.DataFrame = self.table(columns, split).to_pandas()
        return frame

    def iter_batches(
        self, columns: Sequence[str] | None = None, split: str | None = None, batch_rows: int = 65_536
    ) -> Iterator[pa.RecordBatch]:
        """The rows in order, at most batch_rows at a time, in constant memory. Raises as `table`."""
        if batch_rows < 1:
            raise UsageError(f"batch_rows: found {batch_rows}, expected at least 1")
        return _batches(self._files(split), self._columns(columns), batch_rows)

    def arrays(self, history: int = 1, split: str | None = None) -> dict[str, npt.NDArray[Any]]:
        """Arrays as learning libraries take them.

        observations (N, 6 · history) with the newest frame first, the first frame of an episode repeated at
        its start; actions (N, 3); rewards (N,); next_observations (N, 6 · history); terminated, truncated
        (N,) bool; episode, step (N,). A frame is setpoint, velocity, gain, shift, fatigue, consumption.

        Raises UsageError for a history below 1, or a split that the dataset does not have.
        """
        if history < 1:
            raise UsageError(f"history: found {history}, expected at least 1")
        groups = self.info["groups"]
        roles = ("observation", "action", "reward", "next_observation")
        names = ["episode", "step", "terminated", "truncated"]
        table = self.table([*names, *(name for role in roles for name in groups[role])], split)

        def stack(role: str) -> npt.NDArray[Any]:
            return np.stack([table[name].to_numpy() for name in groups[role]], axis=1)

        out = {name: table[name].to_numpy() for name in names}
        observations, after = stacked(stack("observation"), stack("next_observation"), out["step"], history)
        return {
            "observations": observations,
            "actions": stack("action"),
            "rewards": table["reward"].to_numpy(),
            "next_observations": after,
            **out,
        }

    def _json(self, path: str) -> dict[str, Any]:
        try:
            data: dict[str, Any] = json.loads(manifest.content(self.path, path))
        except (OSError, ValueError) as error:
            raise DatasetError(f"{self.path / path}: cannot be read: {error}") from None
        return data

    def _columns(self, columns: Sequence[str] | None) -> list[str]:
        known = [column["name"] for column in self.info["columns"]]
        if columns is None:
            return known
        if isinstance(columns, str) or not columns or len(set(columns)) < len(columns):
            raise UsageError(f"columns: found {columns!r}, expected a list of different names")
        unknown = [name for name in columns if name not in known]
        if unknown:
            raise UsageError(f"column: found {unknown[0]!r}, expected one of {', '.join(known)}")
        return list(columns)

    def _files(self, split: str | None) -> list[Path]:
        """The files of the dataset, or of a split, in order."""
        shards = [shard["path"] for shard in self.manifest["shards"]]
        if split is not None:
            files = self.info["splits"][self._known(split)]["files"]
            shards = [path for path in shards if path in files]
        return [manifest.locate(self.path, path) for path in shards]

    def _known(self, split: str) -> str:
        """The split itself, if the dataset has it."""
        splits = self.info["splits"]
        if split not in splits:
            known = f"one of {', '.join(splits)}" if splits else "none: the dataset declares no splits"
            raise UsageError(f"split: found {split!r}, expected {known}")
        return split


@contextmanager
def _readable(file: Path) -> Iterator[None]:
    """What cannot be read, as one line."""
    try:
        yield
    except (OSError, pa.ArrowException) as error:
        reason = str(error).splitlines()[0]
        raise DatasetError(f"{file}: cannot be read, see ibdata validate: {reason}") from None


def _read(file: Path, names: list[str] | None) -> pa.Table:
    with _readable(file):
        return pq.read_table(file, columns=names, page_checksum_verification=True)


def _batches(files: list[Path], names: list[str], batch_rows: int) -> Iterator[pa.RecordBatch]:
    for file in files:
        with _readable(file), pq.ParquetFile(file, page_checksum_verification=True) as parquet:
            yield from parquet.iter_batches(batch_rows, columns=names)
