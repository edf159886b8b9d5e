"""Whether the mean weight of each step is 1, as it must be if the densities are right."""

from __future__ import annotations

import math

import numpy as np

from ibdata.evaluation.overlap import Ratios
from ibdata.simulation.episodes import Floats

WRONG = 8.0  # errors from 1; if the densities are right, less than one of 1,000 calls goes so far
LACKING = 4.0  # errors from 1, beyond which the weighted estimate has a warning
TOLERANCE = 1e-3  # more than float32 changes in the recorded log densities of 1,000 steps
FEWEST = 100  # episodes that are looked at; fewer have a warning anyway
# A weight above this share of the episodes has too few like it for a standard error. By π, which no weight of
# policies that choose among a few actions is a fraction of, so that rounding makes no weight large.
LARGE = 1.0 / (64.0 * math.pi)


def notes_on_mean_weights(ratios: Ratios, weights: Floats) -> list[str]:
    """A warning for the first step whose mean weight is not 1.

    Heavy tails make a mean fall short of 1 by many of its estimated errors, although nothing is wrong. So
    the test of the densities is of `without_large` weights, whose mean is 1 too. If they pass it, the weights
    themselves tell whether the data lack episodes.
    """
    if len(weights) < FEWEST:
        return []
    kept, large = without_large(ratios)
    if far := _first_far(kept + large, WRONG):
        return [f"{far[1]}, further from 1 than chance allows: one of the densities is wrong"]
    if far := _first_far(weights, LACKING):
        step, place = far
        return [
            f"{place}, more than {LACKING:g} errors from 1; weighted may miss episodes too rare for these "
            f"data, from which {min(large[:, step].mean(), 1.0):.0%} of the expectation comes"
        ]
    return []


def _first_far(weights: Floats, errors: float) -> tuple[int, str] | None:
    """The first step whose mean weight is more than so many errors from 1, and how a warning of it begins."""
    mean, error = weights.mean(axis=0), weights.std(axis=0, ddof=1) / np.sqrt(len(weights))
    far = np.abs(mean - 1.0) > errors * error + TOLERANCE
    if not far.any():
        return None
    step = int(far.argmax())
    return step, f"warning: the mean weight of step {step} is {mean[step]:.3g} ± {error[step]:.2g}"


def without_large(ratios: Ratios) -> tuple[Floats, Floats]:
    """Weights without the large ones, and the weights that large ones would have added, (n, steps) each.

    An episode ends where its weight gets large, so its later weights are 0. How much that takes away from the
    mean is known without the rare episodes in which it happens: it is the weight of the step before, times
    the probability that the target's action makes it large. One drawn action estimates that without bias. So
    the mean of the sum of both is 1, and its terms are bounded.
    """
    log_largest = math.log(LARGE * max(len(ratios.recorded), 500))
    kept, large = np.empty_like(ratios.recorded), np.empty_like(ratios.recorded)
    log_weight, added = np.zeros(len(kept)), np.zeros(len(kept))
    for t in range(kept.shape[1]):
        added = added + np.where(log_weight + ratios.drawn[:, t] > log_largest, np.exp(log_weight), 0.0)
        log_weight = log_weight + ratios.recorded[:, t]
        log_weight[log_weight > log_largest] = -np.inf
        kept[:, t], large[:, t] = np.exp(log_weight), added
    return kept, large
