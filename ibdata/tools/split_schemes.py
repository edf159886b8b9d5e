"""Schemes of splits that take more than a line to write: each returns a mapping for `ibdata.split`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from ibdata._numerics.arguments import public
from ibdata._numerics.naming import counted, exact
from ibdata.dataset.dataset import Place, to_write
from ibdata.errors import UsageError
from ibdata.plan.dataset_spec import DatasetSpec, spec_in

SplitsByName = dict[str, dict[str, Any] | None]  # None removes a split that an earlier call made
FRACTION_NAMES = {2: ("train", "test"), 3: ("train", "validation", "test")}  # by the number of fractions


@public
def transfer(
    dataset: Place,
    source: float | Sequence[float] | None = None,
    target: float | Sequence[float] | None = None,
    shots: int | None = None,
) -> SplitsByName:
    """Make `source` and `target` by setpoint, and `target-rest`.

    Hein et al. 2017 suggest a transfer from p = 50 to p = 75 and give no sizes.

    Args:
        dataset: A dataset, or its folder.
        source: The setpoint or setpoints of `source`.
        target: Those of `target`.
        shots: The number of episodes in `target` from each cell of a target setpoint and a policy; the others
            are `target-rest`. By default all are in `target`.

    Returns:
        The splits by name.

    Raises:
        UsageError: A setpoint is missing, unknown, or in both, or a cell has fewer episodes than shots.
    """
    for name, setpoints in (("source", source), ("target", target)):
        if setpoints is None:
            raise UsageError(f"transfer: found no {name}, expected setpoints such as source=50 target=70")
    few = {} if shots is None else {"episodes": shots}
    splits: SplitsByName = {"source": {"setpoint": source}, "target": {"setpoint": target, **few}}
    spec = _spec(dataset)
    most = max(spec.sizes(spec.checked(splits)["target"]))
    rest = None
    if shots is not None and shots < most:
        rest = {"setpoint": target, "episodes": {"start": shots, "stop": most - 1}}
    return {**splits, "target-rest": rest}


@public
def leave_one_out(dataset: Place) -> SplitsByName:
    """Make for every setpoint p `test-p` with the episodes at p, and `train-p` with all others.

    Args:
        dataset: A dataset, or its folder.

    Returns:
        The splits by name.

    Raises:
        UsageError: The dataset has one setpoint.
    """
    return folds(_spec(dataset).setpoints)


def folds(known: Sequence[float]) -> SplitsByName:
    """The splits of `leave_one_out` for these setpoints."""
    if len(known) < 2:
        raise UsageError("split: found one setpoint, expected at least 2 to leave one out")
    made: SplitsByName = {}
    for test in known:
        train = [setpoint for setpoint in known if setpoint != test]
        name = exact(test).replace(".", "_")
        made[f"train-{name}"] = {"setpoint": train, "overlap": True}
        made[f"test-{name}"] = {"setpoint": test, "overlap": True}
    return made


@public
def by_episode(dataset: Place, fractions: Sequence[float] = (0.8, 0.1, 0.1)) -> SplitsByName:
    """Make `train`, `validation` and `test` of the first to the last episodes of every cell.

    The episodes of a cell are independent and identically distributed, so they need no shuffling.

    Args:
        dataset: A dataset, or its folder.
        fractions: Their shares of each cell; two are those of `train` and `test`.

    Returns:
        The splits by name.

    Raises:
        UsageError: The fractions do not sum to 1, one has no episode, or the cells differ in their sizes.
    """
    names = FRACTION_NAMES.get(len(fractions))
    if names is None or min(fractions) <= 0 or not math.isclose(sum(fractions), 1.0, abs_tol=1e-9):
        numbers = ", ".join(f"{fraction:.15g}" for fraction in fractions)
        raise UsageError(f"split: found fractions {numbers}, expected 2 or 3 above 0 that sum to 1")
    counts = {experiment.episodes for experiment in _spec(dataset).experiments}
    if len(counts) > 1:
        raise UsageError(
            "split: found cells of several sizes, expected the same number of episodes in each; episodes of "
            "a split such as 'first 80%' fit any size"
        )
    n = counts.pop()
    bounds = [round(n * sum(fractions[:i])) for i in range(len(names))] + [n]
    splits: SplitsByName = dict.fromkeys(FRACTION_NAMES[3])
    for name, (low, high) in zip(names, pairwise(bounds), strict=True):
        if low >= high:
            found = f"found {counted(n, 'episode')} in each cell, of which {name} has none"
            raise UsageError(f"split: {found}; expected more episodes, or other fractions")
        splits[name] = {"episodes": {"start": low, "stop": high - 1}}
    return splits


@public
def by_policy(dataset: Place) -> SplitsByName:
    """Make a split of each policy, named by its label.

    Args:
        dataset: A dataset, or its folder.

    Returns:
        The splits by name.
    """
    return {label: {"policy": label} for label in _spec(dataset).labels}


def _spec(dataset: Place) -> DatasetSpec:
    return spec_in(to_write(dataset).stored)


SCHEMES: Mapping[str, Callable[..., SplitsByName]] = {
    "transfer": transfer,
    "leave-one-out": leave_one_out,
    "episode": by_episode,
    "policy": by_policy,
}
