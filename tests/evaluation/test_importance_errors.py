"""The standard errors of the estimates by importance weights are those of the jackknife."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata.evaluation.importance import METHODS, Ratios, of_ratios


def estimates(log_ratios, rewards):
    return {
        each.method: each for each in of_ratios("x", Ratios(log_ratios, log_ratios), rewards, 0.9).results
    }


def test_errors_equal_the_jackknife():
    """To the last digits for means; of the weighted estimate, a ratio, to the order 1/n."""
    episodes, rng = 300, np.random.default_rng(1)
    log_ratios = rng.normal(-0.02, 0.2, (episodes, 4))
    rewards = 5.0 + 10.0 * log_ratios + rng.normal(0.0, 1.0, log_ratios.shape)
    found = estimates(log_ratios, rewards)
    others = [
        estimates(np.delete(log_ratios, i, axis=0), np.delete(rewards, i, axis=0)) for i in range(episodes)
    ]
    for method in METHODS:
        values = np.array([each[method].mean_return for each in others])
        error = np.sqrt((episodes - 1) / episodes * ((values - values.mean()) ** 2).sum())
        near = 4.0 / episodes if method == "weighted" else 1e-6
        assert found[method].standard_error == pytest.approx(error, rel=near), method
