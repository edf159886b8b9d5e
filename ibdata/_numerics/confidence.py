"""Means with standard errors and confidence intervals, independent of the order of the values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

LEVEL = 0.95
REACH = 12.0  # in standard deviations; the probability beyond it is below the precision of a double


class MeanEstimate(NamedTuple):
    """A mean with its standard error and 95 % interval, which are None if a group has only one value."""

    mean: float
    standard_error: float | None
    interval: tuple[float, float] | None


def mean_estimate(groups: Sequence[npt.NDArray[np.float64]]) -> MeanEstimate:
    """The mean of the means of independent groups of values, with a Student's t interval.

    The degrees of freedom are those of Welch and Satterthwaite.

    Args:
        groups: one array of values per group, such as the returns of the episodes at one setpoint.

    Returns:
        The mean, its standard error and its 95 % interval.

    >>> mean, error, interval = mean_estimate([np.array([1.0, 2.0, 3.0])])
    >>> mean, round(error, 6), [round(x, 4) for x in interval]
    (2.0, 0.57735, [-0.4841, 4.4841])
    """
    means = [math.fsum(values) / len(values) for values in groups]
    mean = math.fsum(means) / len(groups)
    freedom = [len(values) - 1 for values in groups]
    if min(freedom) == 0:
        return MeanEstimate(mean, None, None)
    variances = [
        math.fsum((values - m) ** 2) / n / (n + 1)
        for values, m, n in zip(groups, means, freedom, strict=True)
    ]
    total = math.fsum(variances)
    error = math.sqrt(total) / len(groups)
    if error == 0.0:
        return MeanEstimate(mean, 0.0, (mean, mean))
    half = error * t_quantile(_freedom(variances, freedom))
    return MeanEstimate(mean, error, (mean - half, mean + half))


def _freedom(variances: Sequence[float], freedom: Sequence[int]) -> float:
    """Degrees of freedom of a sum of means, from the variance and the degrees of freedom of each mean."""
    if len(freedom) == 1:
        return freedom[0]
    return math.fsum(variances) ** 2 / math.fsum(v**2 / n for v, n in zip(variances, freedom, strict=True))


@lru_cache
def t_quantile(freedom: float) -> float:
    """The t for which P(|T| < t) = 0.95, where T has Student's distribution.

    With t = √ν tan θ, the density of θ is proportional to cos(θ) to the ν - 1. The trapezoidal rule
    integrates it, which gives t to 1e-6.

    >>> [round(t_quantile(n), 4) for n in (1, 2, 9, 99)]
    [12.7062, 4.3027, 2.2622, 1.9842]
    """
    theta = np.linspace(0.0, min(math.pi / 2.0, REACH / math.sqrt(freedom)), 20_001)
    height = np.cos(theta) ** (freedom - 1.0)
    area = np.concatenate([[0.0], np.cumsum(height[1:] + height[:-1])])
    return float(math.sqrt(freedom) * math.tan(np.interp(LEVEL * area[-1], area, theta)))
