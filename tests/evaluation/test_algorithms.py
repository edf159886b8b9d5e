"""The intervals of algorithms cover the mean of new trainings and new episodes."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata.evaluation.algorithms import KNOWN, YOURS, LineReturns, estimated
from ibdata.evaluation.baselines import shipped_baselines


def covered(returns, mean, minus=None):
    """Whether the interval of some trainings (seeds, setpoints, episodes) holds the mean."""
    reference = None if minus is None else LineReturns("b", KNOWN, False, minus[None])
    low, high = estimated(LineReturns("a", YOURS, True, returns), reference).interval
    return low <= mean <= high


@pytest.mark.parametrize(("seeds", "spread"), [(2, 1.0), (3, 0.3), (3, 5.0), (10, 1.0)])
def test_intervals_cover_what_they_say(seeds, spread):
    """Of 600 intervals at least 93 % cover, which intervals of 90 % would not in 99 % of cases.

    The episodes are common to all trainings, and the difference from a known policy is tested.
    """
    rng, hits = np.random.default_rng(0), 0
    for _ in range(600):
        episodes, each = rng.normal(size=(1, 8)), rng.normal(size=(seeds, 1, 8))
        made = 3.0 + rng.normal(size=(seeds, 1, 1)) * spread + episodes + each
        hits += covered(made, 3.0, rng.normal(size=(1, 8)) * 0.1)
    assert hits / 600 >= 0.93


@pytest.mark.slow
def test_intervals_cover_in_our_own_cells():
    """Of all shipped cells of three seeds, with new normal trainings and episodes drawn again."""
    cells: dict = {}
    for line in shipped_baselines():
        for number, evaluated in enumerate(line.evaluations):
            if line.seed is not None and evaluated.values is not None:
                cells.setdefault((line.set, line.trained_on, line.algorithm, number), []).append(
                    evaluated.values
                )
    rng, rates, without = np.random.default_rng(0), [], []
    for returns in (np.array(cell) for cell in cells.values() if len(cell) == 3):
        means = returns.mean(axis=(1, 2), keepdims=True)
        residuals = returns - returns.mean(axis=2, keepdims=True)
        profile = returns.mean(axis=2, keepdims=True) - means
        hits, of_one = 0, 0
        for _ in range(20):
            drawn = rng.integers(returns.shape[2], size=returns.shape[2])
            levels = rng.normal(size=means.shape) * means.std(ddof=1)
            made = means.mean() + levels + (profile + residuals)[:, :, drawn]
            hits += covered(made, means.mean())
            of_one += covered(made[[0, 0]], means.mean())  # as if trainings had no spread
        rates.append(hits / 20)
        without.append(of_one / 20)
    assert len(rates) > 200
    print(f"coverage {np.mean(rates):.3f}, {np.mean(without):.3f} over episodes alone, of {len(rates)} cells")
    assert 0.93 <= np.mean(rates) <= 0.975
    assert np.mean(without) < 0.5
