"""The random integers of many lanes, read ahead from a generator for each, so that few calls are needed."""

from __future__ import annotations

from typing import Any

import numpy as np

from ibdata.environment.replayed import Noise
from ibdata.environment.simulation import Indices
from ibdata.numerics.philox import Raw

AHEAD = 512  # integers


class Streams:
    """n generators, seeded as Gymnasium seeds the environment of a lane."""

    def __init__(self, n: int) -> None:
        self._generators: list[np.random.Generator | None] = [None] * n
        self._seeds: list[int] = [-1] * n
        self._replayed: list[Noise | None] = [None] * n
        # Rows 0 … n - 1 are read from the generators, rows n … 2n - 1 from what is replayed instead of them.
        self._rows = np.arange(n)
        self._ahead = np.empty((2 * n, AHEAD), dtype=np.uint64)
        self._at = np.full(2 * n, AHEAD)

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

    def replay(self, lane: int, noise: Noise) -> None:
        """Let a lane take these integers, until `resume` leads back to those of its generator."""
        row = lane + len(self._seeds)
        self._replayed[lane], self._rows[lane], self._at[row] = noise, row, AHEAD

    def resume(self, which: Indices) -> None:
        """Let lanes go on with the integers of their generators."""
        self._rows[which] = which

    def take(self, which: Indices, count: int) -> Raw:
        """The next integers (lanes, count) of some lanes."""
        rows = self._rows[which]
        for row in rows[self._at[rows] + count > AHEAD].tolist():
            at, ahead = self._at[row], self._ahead[row]
            ahead[: AHEAD - at] = ahead[at:].copy()
            ahead[AHEAD - at :] = self._source(row).random_raw(int(at))
            self._at[row] = 0
        columns = self._at[rows, None] + np.arange(count)
        self._at[rows] += count
        return self._ahead[rows[:, None], columns]

    def _source(self, row: int) -> Any:
        lane = row % len(self._seeds)
        return self._generator(lane).bit_generator if row == lane else self._replayed[lane]

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
