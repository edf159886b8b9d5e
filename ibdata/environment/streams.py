"""The random integers of many lanes, read ahead from a generator for each, so that few calls are needed."""

from __future__ import annotations

import numpy as np

from ibdata.environment.simulation import Indices
from ibdata.numerics.philox import Raw

AHEAD = 512  # integers


class Streams:
    """n generators, seeded as Gymnasium seeds the environment of a lane."""

    def __init__(self, n: int) -> None:
        self._generators: list[np.random.Generator | None] = [None] * n
        self._seeds: list[int] = [-1] * n
        self._ahead = np.empty((n, AHEAD), dtype=np.uint64)
        self._at = np.full(n, AHEAD)

    @property
    def generators(self) -> tuple[np.random.Generator, ...]:
        """The generators; those of lanes that had none yet are seeded from the operating system."""
        return tuple(self._generator(lane) for lane in range(len(self._seeds)))

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds of the generators."""
        return tuple(seed for _, seed in zip(self.generators, self._seeds, strict=True))

    def seed(self, lane: int, seed: int | None) -> None:
        """Restart the stream of a lane with a seed; None leaves it as it is."""
        if seed is not None:
            self._make(lane, seed)

    def take(self, which: Indices, count: int) -> Raw:
        """The next integers (lanes, count) of some lanes."""
        for lane in which[self._at[which] + count > AHEAD].tolist():
            at, ahead = self._at[lane], self._ahead[lane]
            ahead[: AHEAD - at] = ahead[at:].copy()
            ahead[AHEAD - at :] = self._generator(lane).bit_generator.random_raw(int(at))
            self._at[lane] = 0
        columns = self._at[which, None] + np.arange(count)
        self._at[which] += count
        return self._ahead[which[:, None], columns]

    def _generator(self, lane: int) -> np.random.Generator:
        generator = self._generators[lane]
        return self._make(lane, None) if generator is None else generator

    def _make(self, lane: int, seed: int | None) -> np.random.Generator:
        from gymnasium.utils import seeding

        generator: np.random.Generator
        generator, self._seeds[lane] = seeding.np_random(seed)
        self._generators[lane] = generator
        self._at[lane] = AHEAD
        return generator
