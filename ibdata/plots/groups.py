"""Groups of episodes by setpoint and policy, few enough to be told apart in a picture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.dataset.reader import Dataset
from ibdata.errors import DatasetError
from ibdata.plots.style import SERIES

MOST_SETPOINTS = 12
Numbers = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]


class Episodes(NamedTuple):
    """The names of the groups of setpoints and of policies, and the groups, length … of each episode (n,)."""

    setpoints: list[str]
    policies: list[str]
    setpoint: Numbers
    policy: Numbers
    length: Numbers
    returns: Floats
    splits: list[tuple[str, ...]]

    def cell(self) -> Numbers:
        """The number of each episode's combination of group of setpoints and policy."""
        return self.setpoint * len(self.policies) + self.policy


def episodes_of(dataset: Dataset) -> Episodes:
    """Group the episodes of a dataset. Raises DatasetError if a setpoint or return is not a finite number.

    With more than 12 setpoints, neighbours share a group. With more than 7 policies, the last group has all
    others.
    """
    frame = dataset.episodes
    setpoint, returns = frame["setpoint"].to_numpy(), frame["return"].to_numpy()
    if not (np.isfinite(setpoint).all() and np.isfinite(returns).all()):
        raise DatasetError(
            f"{dataset.place}: found a setpoint or return that is infinite or nan, expected finite numbers; "
            f"see ibdata validate {dataset.place}"
        )
    values, number = np.unique(setpoint, return_inverse=True)
    runs = np.array_split(np.arange(len(values)), min(len(values), MOST_SETPOINTS))
    group_of = np.repeat(np.arange(len(runs)), [len(run) for run in runs])
    labels = list(dict.fromkeys(frame["policy"]))
    shown = labels if len(labels) <= len(SERIES) else [*labels[: len(SERIES) - 1], None]
    policies = [f"{len(labels) - len(shown) + 1} others" if label is None else label for label in shown]
    which = {label: min(i, len(shown) - 1) for i, label in enumerate(labels)}
    return Episodes(
        [_span(values[run]) for run in runs],
        policies,
        group_of[number],
        np.array([which[label] for label in frame["policy"]]),
        frame["length"].to_numpy(),
        returns,
        [tuple(names) for names in frame["splits"]],
    )


def _span(values: Floats) -> str:
    """Setpoints as a label.

    >>> _span(np.array([10.0, 20.0, 30.0]))
    '10 – 30'
    """
    return f"{values[0]:g}" if len(values) == 1 else f"{values[0]:g} – {values[-1]:g}"
