"""The measures of quality that need only the returns of episodes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata.dataset.models import Info
from ibdata.dataset.reference_returns import EXPERT, scale_of

MEANING = {
    "trajectory_quality": "mean return: 0 = random, 1 = expert",
    "return_improvement": "(best return - mean return) / (mean return - lowest return)",
}
Floats = npt.NDArray[np.float64]


def trajectory_quality(mean_return: float, minimal: float, expert: float) -> float:
    """Trajectory quality TQ, which is 0 for the minimal policy and 1 for the expert.

        TQ = (ḡ(D) - ḡ(D_min)) / (ḡ(D_expert) - ḡ(D_min))

    Schweighofer et al. 2022 (arXiv 2111.04714); ḡ is the mean return of episodes.

    >>> trajectory_quality(-250_000.0, minimal=-300_000.0, expert=-200_000.0)
    0.5
    """
    return (mean_return - minimal) / (expert - minimal)


def return_improvement(returns: Floats) -> float | None:
    """Estimated relative return improvement ERI: how far the best episode is above the mean one.

        ERI = (max R - mean R) / mean R, with returns R >= 0

    Swazinna, Udluft and Runkler 2021 (arXiv 2111.13461). The returns (n,) of the Industrial Benchmark are
    negative, so the least one is subtracted from all, as two published implementations do. None if all
    are equal.

    >>> return_improvement(np.array([-400.0, -300.0, -200.0, 0.0]))  # shifted: 0, 100, 200, 400, mean 175
    1.2857142857142858
    """
    low, mean, high = float(returns.min()), math.fsum(returns) / len(returns), float(returns.max())
    return None if high == low else (high - mean) / (mean - low)


class ReturnMeasures(NamedTuple):
    """Both measures; None where there are no reference returns, or no two different returns to compare."""

    trajectory_quality: float | None
    return_improvement: float | None


def return_measures(episodes: pa.Table, info: Info) -> ReturnMeasures:
    """Both measures of episodes that may have several setpoints and lengths.

    The minimal policy is `random` and the expert `expert`, each at the setpoint of the episode. Returns at
    different setpoints cannot be compared, so the improvement is computed for each setpoint and length, and
    averaged with the numbers of episodes as weights. Returns are undiscounted. With several dynamics, as
    merged datasets may have, both measures are None.
    """
    setpoints, lengths, returns = (
        np.array(episodes[name].to_pylist()) for name in ("setpoint", "length", "return")
    )
    ends, improvements, weights = [], [], []
    for p, steps in np.unique(np.column_stack([setpoints, lengths]), axis=0).tolist():
        at_setpoint = returns[(setpoints == p) & (lengths == steps)]
        scale = scale_of(info, int(steps))
        end = scale.ends([p], EXPERT) if scale else None
        ends.append(None if end is None else (len(at_setpoint) * end[0], len(at_setpoint) * end[1]))
        if info.dynamics is not None and (improvement := return_improvement(at_setpoint)) is not None:
            improvements.append(improvement)
            weights.append(len(at_setpoint))
    known = [end for end in ends if end is not None]
    quality = None
    if len(known) == len(ends):
        quality = trajectory_quality(
            math.fsum(returns), *(math.fsum(end) for end in zip(*known, strict=True))
        )
    improvement = float(np.average(improvements, weights=weights)) if improvements else None
    return ReturnMeasures(quality, improvement)
