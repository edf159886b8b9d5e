"""The network that predicts fatigue and consumption, of docs/quality.md and docs/quality.md."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

HIDDEN, BATCH = (64, 64), 256
Floats = npt.NDArray[np.float64]
Model = Callable[[Floats], Floats]  # fatigue and consumption (n, 2) from features (n, k)


def fitted_network(x: Floats, y: Floats, passes: int) -> Model:
    """A network on standardised features (n, k) and targets (n, 2), fitted in so many passes."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.neural_network import MLPRegressor

    center, spread, mean, scale = x.mean(axis=0), deviation(x), y.mean(axis=0), deviation(y)
    network = MLPRegressor(
        hidden_layer_sizes=HIDDEN, batch_size=BATCH, max_iter=passes, tol=0.0, random_state=0
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # the number of passes is fixed
        network.fit((x - center) / spread, (y - mean) / scale)
    return lambda x: network.predict((x - center) / spread) * scale + mean


def deviation(x: npt.NDArray[Any]) -> Floats:
    """The standard deviation of each column, 1 where it is 0."""
    std: Floats = x.std(axis=0)
    return np.where(std > 0.0, std, 1.0)
