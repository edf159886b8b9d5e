"""What the pictures of a dataset show: its episodes in groups, and counts of its rows."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ibdata.dataset.dataset import Dataset
from ibdata.errors import DatasetError
from ibdata.plots.counts import count
from ibdata.plots.style import SERIES, Floats

MOST_SETPOINTS = 12


class Summary:
    """A dataset with its rows counted and its episodes in groups, few enough to be told apart in a picture.

    With more than 12 setpoints, neighbours share a group. With more than 7 policies, the last group has all
    others.

    Attributes:
        setpoints, policies: The names of the groups.
        levels: The middle of each group of setpoints.
        setpoint, policy: The groups of each episode (n,), by number.
        counts: Histograms over all rows.

    Raises:
        DatasetError: A setpoint or return is not a finite number, or rows or statistics are damaged.
    """

    def __init__(self, dataset: Dataset, progress: bool | None = False) -> None:
        self.dataset = dataset
        self.episodes = dataset.episodes
        values, number = np.unique(self._finite("setpoint"), return_inverse=True)
        runs = np.array_split(values, min(len(values), MOST_SETPOINTS))
        self.setpoints = [f"{run[0]:g}" if len(run) == 1 else f"{run[0]:g} – {run[-1]:g}" for run in runs]
        self.levels = np.array([(run[0] + run[-1]) / 2 for run in runs])
        self.setpoint = np.repeat(np.arange(len(runs)), [len(run) for run in runs])[number]
        self.policies, self.policy = _first(list(self.episodes["policy"]))
        self.returns = self._finite("return")
        cells = (len(self.setpoints), len(self.policies))
        self.counts = count(dataset, cells, self.setpoint, self.policy, progress)

    def _finite(self, name: str) -> Floats:
        values = self.episodes[name].to_numpy()
        if not np.isfinite(values).all():
            place = self.dataset.place
            raise DatasetError(
                f"{place}: found a {name} that is infinite or nan, expected finite numbers; see ibdata "
                f"validate {place}"
            )
        return values

    def label(self, column: str) -> str:
        """The label of a column on an axis: its meaning and its unit, from meta/dataset.json."""
        [described] = [entry for entry in self.dataset.stored.info.columns if entry.name == column]
        unit = {"1": "", "cost": " (cost units)"}.get(described.unit, f" ({described.unit})")
        return f"{described.description}{unit}"

    @property
    def setpoint_label(self) -> str:
        """The label of the groups of setpoints."""
        return "setpoint p at the start" if self.dataset.stored.info.drifting else "setpoint p"


def _first(policy: list[str]) -> tuple[list[str], npt.NDArray[np.int64]]:
    """The policies, or the first six and the number of the others, and the group of each episode."""
    labels = list(dict.fromkeys(policy))
    shown, most = labels, len(SERIES)
    if len(labels) > most:
        shown = [*labels[: most - 1], f"{len(labels) - most + 1} others"]
    group_of = {label: min(i, len(shown) - 1) for i, label in enumerate(labels)}
    return shown, np.array([group_of[label] for label in policy])
