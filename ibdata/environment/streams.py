"""The random integers of many lanes, read ahead from a generator for each, so that few calls are needed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ibdata._numerics.compiled import compiled
from ibdata._numerics.random import Purpose, Raw
from ibdata.environment.replayed import RecordedStream
from ibdata.environment.simulation import Indices
from ibdata.errors import UsageError

AHEAD = 512  # integers


def refuse_negative(seeds: Sequence[int | None]) -> None:
    """Raise UsageError for a seed below 0."""
    for seed in seeds:
        if seed is not None and seed < 0:
            raise UsageError(f"seed: found {seed}, expected a whole number of at least 0")


@compiled
def take(ahead: Raw, at: Indices, rows: Indices, out: Raw) -> bool:
    """Move the next integers of rows (k,) into out (count, k), unless one has too few. Returns whether."""
    count = out.shape[0]
    for i in range(rows.shape[0]):
        if at[rows[i]] + count > ahead.shape[1]:
            return False
    for i in range(rows.shape[0]):
        row = rows[i]
        for j in range(count):
            out[j, i] = ahead[row, at[row] + j]
        at[row] += count
    return True


class Streams:
    """n generators, seeded as Gymnasium seeds the environment of a lane."""

    def __init__(self, n: int) -> None:
        self.generators = [np.random.default_rng() for _ in range(n)]
        self._replayed: list[RecordedStream | None] = [None] * n
        # Rows 0 … n - 1 are read from the generators, rows n … 2n - 1 from what is replayed instead of them.
        self._rows = np.arange(n)
        self._ahead = np.empty((2 * n, AHEAD), dtype=np.uint64)
        self._at = np.full(2 * n, AHEAD)

    def seed(self, lane: int, seed: int | None) -> None:
        """Restart the stream of a lane with a seed; None leaves it as it is."""
        if seed is not None:
            self.generators[lane], self._at[lane] = np.random.default_rng(seed), AHEAD

    def replay(self, lane: int, noise: RecordedStream) -> None:
        """Let a lane take these integers, until `resume` leads back to those of its generator."""
        row = lane + len(self.generators)
        self._replayed[lane], self._rows[lane], self._at[row] = noise, row, AHEAD

    def resume(self, which: Indices) -> None:
        """Let lanes go on with the integers of their generators."""
        self._rows[which] = which

    def draw(self, which: Indices, purpose: Purpose, step: int, steps: int, slots: int) -> Raw:
        """The next integers (steps, slots, k) of lanes (k,), whatever their address."""
        rows, out = self._rows[which], np.empty((steps * slots, len(which)), dtype=np.uint64)
        while not take(self._ahead, self._at, rows, out):
            self._read(rows[self._at[rows] + len(out) > AHEAD])
        return out.reshape(steps, slots, len(which))

    def _read(self, rows: Indices) -> None:
        """Read the integers ahead that rows (k,) have room for."""
        for row, at in zip(rows.tolist(), self._at[rows].tolist(), strict=True):
            if at < AHEAD:
                self._ahead[row, : AHEAD - at] = self._ahead[row, at:].copy()
            self._ahead[row, AHEAD - at :] = self._source(row).random_raw(at)
        self._at[rows] = 0

    def _source(self, row: int) -> Any:
        n = len(self.generators)
        return self.generators[row].bit_generator if row < n else self._replayed[row - n]
