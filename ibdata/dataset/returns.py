"""The returns of a dataset's behaviour, scored on the scale of the reference returns."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple, TypedDict

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata._numerics.arrays import Ints
from ibdata._numerics.confidence import mean_estimate
from ibdata._numerics.naming import decimal
from ibdata.dataset.models import Info
from ibdata.dataset.reference_returns import scale_of
from ibdata.dataset.tabular import Table

Objects = npt.NDArray[np.object_]


class ReturnsOf(TypedDict):
    """The returns of a policy at a setpoint, undiscounted. Errors and score are None for one episode.

    Attributes:
        policy: the label of the policy.
        setpoint: the setpoint; of episodes in which it moves, that in the experiment.
        episodes: the number of episodes.
        steps: the number of steps of an episode.
        mean_return: the mean of their returns.
        standard_error: the standard error of `mean_return`.
        interval: the 95 % interval of `mean_return`.
        mean_reward: the mean reward of a step.
        reference: the stored mean returns of `random` and `optimized`, which have the scores 0 and 100.
        score: where `mean_return` is between these.
        score_error: the standard error of `score`, from the episodes of the dataset.
    """

    policy: str
    setpoint: float
    episodes: int
    steps: int
    mean_return: float
    standard_error: float | None
    interval: tuple[float, float] | None
    mean_reward: float
    reference: tuple[float, float] | None
    score: float | None
    score_error: float | None


class Returns(TypedDict):
    """What `Dataset.returns` gives.

    Attributes:
        results: a `ReturnsOf`, which is a dict, for each policy and setpoint.
        scale: the meaning of the scores; None if there is no reference.
    """

    results: list[ReturnsOf]
    scale: str | None


class Average(NamedTuple):
    """The returns of a policy, or of all (None), over its setpoints with equal weights."""

    policy: str | None
    episodes: int
    steps: int
    mean_return: float
    standard_error: float | None
    mean_reward: float
    score: float | None
    score_error: float | None


def behaviour_returns(episodes: pa.Table, info: Info) -> Returns:
    """The undiscounted returns of a dataset's behaviour.

    Episodes of different lengths, which a merged dataset may have, give separate results.

    Args:
        episodes: The table of episodes.
        info: The description of the dataset.

    Returns:
        A result for each cell and length, in the order of the episodes.
    """
    policies = episodes["policy"].to_pylist()
    # Arrow would import pandas for `to_numpy`, which takes longer than the rest of a small run.
    setpoints, returns, lengths = (
        np.array(episodes[name].to_pylist(), episodes[name].type.to_pandas_dtype())
        for name in ("setpoint", "return", "length")
    )
    cells = np.array(episodes["cell"].to_pylist(), dtype=object)
    scales = {steps: scale_of(info, steps) for steps in np.unique(lengths).tolist()}
    results: list[ReturnsOf] = []
    for numbers in _of_equal(cells, lengths):
        estimated, first = mean_estimate([returns[numbers]]), numbers[0]
        setpoint, steps = decimal(setpoints[first]), int(lengths[first])
        scale, error = scales[steps], estimated.standard_error
        ends = scale.ends([setpoint]) if scale else None
        results.append(
            {
                "policy": policies[first],
                "setpoint": setpoint,
                "episodes": len(numbers),
                "steps": steps,
                "mean_return": estimated.mean,
                "standard_error": error,
                "interval": estimated.interval,
                "mean_reward": estimated.mean / steps,
                "reference": ends,
                "score": scale.score(setpoint, estimated.mean) if scale and error is not None else None,
                "score_error": 100.0 * error / (ends[1] - ends[0]) if ends and error is not None else None,
            }
        )
    scored = {result["steps"] for result in results if result["reference"]}
    texts = [scale.text for steps, scale in scales.items() if scale and steps in scored]
    return {"results": results, "scale": "; ".join(texts) or None}


def _of_equal(cells: Objects, lengths: Ints) -> list[Ints]:
    """The numbers of the episodes of each cell and length, in the order of the first of them."""
    new = (cells[1:] != cells[:-1]) | (lengths[1:] != lengths[:-1])
    starts = [0, *(np.flatnonzero(new) + 1).tolist(), len(cells)]
    runs: dict[tuple[str, int], list[Ints]] = {}
    for start, stop in pairwise(starts):  # a merged dataset may have several runs of a cell
        runs.setdefault((cells[start], int(lengths[start])), []).append(np.arange(start, stop))
    return [np.concatenate(parts) for parts in runs.values()]


def averages(results: Sequence[ReturnsOf]) -> list[Average]:
    """The returns of each policy, and of all policies if there are several whose episodes are equally long.

    Means and scores are those of the setpoints, averaged. A standard error is None if a setpoint has none, a
    score is None if a setpoint has none.
    """
    by_policy: dict[tuple[str, int], list[ReturnsOf]] = {}
    for result in results:
        by_policy.setdefault((result["policy"], result["steps"]), []).append(result)
    averages_by_policy = [_average(policy, part) for (policy, _), part in by_policy.items()]
    if len(by_policy) > 1 and len({steps for _, steps in by_policy}) == 1:
        averages_by_policy.append(_average(None, results))
    return averages_by_policy


def _average(policy: str | None, results: Sequence[ReturnsOf]) -> Average:
    at: dict[float, list[Any]] = {}
    for result in results:
        at.setdefault(result["setpoint"], []).append(result)

    def over_setpoints(combined: Callable[[list[Any]], Any], name: str) -> Any:
        """A value of the results, combined at each setpoint and then over these; None if one has none."""
        known = all(result[name] is not None for part in at.values() for result in part)
        return combined([combined([r[name] for r in part]) for part in at.values()]) if known else None

    mean, steps = over_setpoints(_mean, "mean_return"), results[0]["steps"]
    return Average(
        policy,
        sum(r["episodes"] for r in results),
        steps,
        mean,
        over_setpoints(_error_of_mean, "standard_error"),
        mean / steps,
        over_setpoints(_mean, "score"),
        over_setpoints(_error_of_mean, "score_error"),
    )


def _mean(numbers: Sequence[float]) -> float:
    return math.fsum(numbers) / len(numbers)


def _error_of_mean(errors: Sequence[float]) -> float:
    return math.hypot(*errors) / len(errors)


def results_table(returns: Returns) -> Table:
    """A row for each result, with the scores and the reference if there is one."""
    names = ("policy", "setpoint", "episodes", "return", "± s.e.", "random", "optimized", "score", "± s.e.")
    rows = [
        (r["policy"], r["setpoint"], r["episodes"], r["mean_return"], r["standard_error"],
         *(r["reference"] or (None, None)), r["score"], r["score_error"])
        for r in returns["results"]
    ]  # fmt: skip
    shown = len(names) if returns["scale"] else 5
    return Table(names[:shown], [row[:shown] for row in rows])
