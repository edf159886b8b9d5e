"""The data of the pictures of a dataset, read on first use."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.dataset.reader import Dataset
from ibdata.plots.counts import Counts, count
from ibdata.plots.episode import PANELS
from ibdata.plots.groups import Episodes, episodes_of

MOST_STEPS = 1000  # of the episode whose traces are drawn


class Summary:
    """A dataset's episodes, counts and one episode's traces."""

    def __init__(self, dataset: Dataset, progress: bool | None = False) -> None:
        self.dataset, self.progress = dataset, progress
        self.columns = {column.name: column for column in dataset.info_model.columns}

    @cached_property
    def episodes(self) -> Episodes:
        """The episodes in groups."""
        return episodes_of(self.dataset)

    @cached_property
    def counts(self) -> Counts:
        """Histograms over all rows."""
        return count(self.dataset, self.episodes, self.progress)

    @cached_property
    def typical(self) -> int:
        """The number of the episode with the median return, or of the first of several."""
        returns = self.episodes.returns
        return int(np.flatnonzero(returns == np.quantile(returns, 0.5, method="inverted_cdf"))[0])

    @cached_property
    def traces(self) -> Mapping[str, npt.NDArray[Any]]:
        """The first 1000 steps of the typical episode: variables by name, for `episode.draw`."""
        names = {
            variable: column
            for _, lines in PANELS
            for variable, *_ in lines
            for column in (f"obs_{variable}", f"latent_{variable}")
            if column in self.columns
        }
        episode = self.dataset.episodes.iloc[self.typical]
        stop = min(int(episode["row_stop"]), int(episode["row_start"]) + MOST_STEPS)
        parts: list[npt.NDArray[Any]] = [
            np.stack([column.to_numpy() for column in batch.columns])
            for batch in self.dataset.shard_batches(
                int(episode["shard"]), list(names.values()), MOST_STEPS, int(episode["row_start"]), stop
            )
        ]
        return dict(zip(names, np.concatenate(parts, axis=1), strict=True))

    def label(self, column: str) -> str:
        """The label of a column on an axis: its meaning and its unit, from meta/dataset.json."""
        described = self.columns[column]
        unit = {"1": "", "cost": " (cost units)"}.get(described.unit, f" ({described.unit})")
        return f"{described.description}{unit}"

    @property
    def setpoint_label(self) -> str:
        """The label of the groups of setpoints."""
        return "setpoint p at the start" if self.dataset.info_model.drifting else "setpoint p"
