"""A policy of your own, for cautious.yaml beside it."""

import numpy as np


class Cautious:
    """Steers velocity, gain and shift back to 50, by at most `size` a step."""

    def __init__(self, size):
        self.size = size

    def predict(self, observations):  # (n, 6 · history) float32
        return np.clip((50.0 - observations[:, 1:4]) / 50.0, -self.size, self.size)
