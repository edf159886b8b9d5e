"""Imperfect measurements: delay, noise, quantisation and missing values, chosen for each column.

These are troubles of real plants. The random numbers have addresses: (seed, episode, time, column) →
variate. So a view of a dataset is the same however it is read.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arguments import public
from ibdata._numerics.arrays import Bools, Float32s, Floats
from ibdata.errors import UsageError
from ibdata.views.variables import variable_of

LEAST = math.ulp(0.0)
# The least and the greatest number for a column, and both in words. With these, all measurements are finite.
# And whether all that is shown is a true value, which is within the bounds of the column.
KINDS = {
    "delay": (1, 1000, "a whole number of steps, 1 to 1000", True),
    "noise": (LEAST, 1e30, "a standard deviation above 0 and at most 1e+30", False),
    "quantise": (1e-30, sys.float_info.max, "a step of at least 1e-30", False),
    "missing": (LEAST, 1.0, "a probability above 0 and at most 1", True),
}
NOTHING: Mapping[str, Any] = {}
# The variables whose random numbers come from one stream, by their index: this list never changes. Any other
# variable has a stream of its own.
TOGETHER = (
    "setpoint", "velocity", "gain", "shift", "fatigue", "consumption",
    *(f"theta_{lag}" for lag in range(1, 10)),
    "domain", "response", "direction", "mu_v", "mu_g", "drift_rate", "drift_left",
    "convolved_cost", "penalty", "expected_consumption", "effective_shift", "effective_velocity",
    "effective_gain", "alpha", "basic_fatigue",
)  # fmt: skip
DRAWS = 2 * len(TOGETHER)  # of a stream at a step: a normal and a uniform number for each variable


@dataclass(frozen=True)
class Imperfections:
    """How the columns are measured.

    In this order: the value is `delay` steps old (at the beginning of an episode, it is the first one);
    normal noise with the standard deviation `noise` is added; the sum is rounded to multiples of `quantise`;
    and with the probability `missing` the value does not arrive, so that the last one that did is seen again.
    The first value of an episode always arrives. `mask` adds flags, which are 1 where a value did not arrive.
    """

    delay: Mapping[str, int] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    quantise: Mapping[str, float] = field(default_factory=dict)
    missing: Mapping[str, float] = field(default_factory=dict)
    mask: bool = False
    seed: int = 0

    def __bool__(self) -> bool:
        return bool(self.columns)

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """The columns that are measured imperfectly."""
        return tuple(dict.fromkeys(name for kind in KINDS for name in getattr(self, kind)))

    def plain(self) -> dict[str, Any]:
        """The imperfections as users give them; empty if there are none."""
        if not self:
            return {}
        columns = {kind: dict(getattr(self, kind)) for kind in KINDS if getattr(self, kind)}
        return {**columns, "mask": self.mask, "seed": self.seed}


NONE = Imperfections()


class Measurement:
    """The imperfections of k columns, in episodes or in their burn-in."""

    def __init__(self, imperfections: Imperfections, columns: tuple[str, ...], burn_in: bool = False) -> None:
        def per_column(values: Mapping[str, float]) -> Floats:
            return np.array([values.get(name, 0.0) for name in columns])

        self.delay = per_column(imperfections.delay).astype(np.int64)
        self._noise = per_column(imperfections.noise)
        self._quantum = per_column(imperfections.quantise)
        self._missing = per_column(imperfections.missing)
        self._seed, self._burn_in = imperfections.seed, burn_in
        self._streams: dict[bytes, list[tuple[int, int]]] = {}  # the columns of each, and their index in it
        for column, name in enumerate(map(variable_of, columns)):
            is_together = name in TOGETHER
            stream = b"measurement" if is_together else f"measurement {name}".encode()
            place = column, TOGETHER.index(name) if is_together else 0
            self._streams.setdefault(stream, []).append(place)
        self._random = bool(self._noise.any() or self._missing.any())

    def episode(self, clean: Float32s, number: int) -> tuple[Float32s, Bools]:
        """Measure the true values (T + 1, k) of an episode with this number.

        Returns the measured values (T + 1, k), and flags (T + 1, k) of those that did not arrive.
        """
        times = np.arange(len(clean))[:, None]
        delayed = np.take_along_axis(clean, np.maximum(times - self.delay, 0), axis=0)
        arrived, lost = self._measure(delayed, *self._draw(np.array([number]), 0, len(clean)))
        lost[0] = False
        latest = np.maximum.accumulate(np.where(lost, 0, times), axis=0)
        return np.take_along_axis(arrived, latest, axis=0), lost

    def step(self, delayed: Float32s, numbers: npt.NDArray[np.int64], time: int) -> tuple[Float32s, Bools]:
        """Measure the delayed true values (n, k) of episodes with these numbers (n,) at one time.

        Returns the values (n, k), and flags (n, k) of those that do not arrive and are of no use.
        """
        arrived, lost = self._measure(delayed, *self._draw(numbers, time, 1))
        return arrived, lost & (time > 0)

    def _measure(self, delayed: Float32s, normal: Floats, uniform: Floats) -> tuple[Float32s, Bools]:
        """Add noise and round. Returns the values, and flags of those that are missing."""
        values = delayed.astype(np.float64) + self._noise * normal
        quantum = np.where(self._quantum, self._quantum, 1.0)
        values = np.where(self._quantum, np.rint(values / quantum) * quantum, values) + 0.0
        lost = np.broadcast_to(uniform < self._missing, delayed.shape).copy()
        return values.astype(np.float32), lost

    def _draw(self, numbers: npt.NDArray[np.int64], time: int, times: int) -> tuple[Floats, Floats]:
        """Normal and uniform numbers (times, k) of one episode, or (n, k) of n episodes at one time."""
        if not self._random:
            return np.zeros(1), np.ones(1)
        # Imported here, because other views need nothing compiled.
        from ibdata._numerics.random import Purpose, integers, normals_of, slots, stream_key, uniforms

        purpose = Purpose.BURN_IN_MEASUREMENT if self._burn_in else Purpose.MEASUREMENT
        out = np.empty((2, times * len(numbers), len(self.delay)))
        for stream, places in self._streams.items():
            keys = np.tile(stream_key(self._seed, stream), (len(numbers), 1))
            u = np.empty((times, len(numbers), DRAWS))
            uniforms(integers(keys, numbers, purpose, time, times, slots(DRAWS)), u)
            columns, index = np.array(places).T
            out[:, :, columns] = u.reshape(-1, len(TOGETHER), 2)[:, index].transpose(2, 0, 1)
        return normals_of(out[0]), out[1]


def imperfections_of(options: Mapping[str, Any] | None) -> Imperfections:
    """Check the imperfections of a user. Raises UsageError if they are not valid."""
    try:
        if options is None:
            return NONE
        return _checked(**{str(name): value for name, value in options.items()})
    except UsageError as error:
        raise UsageError(f"imperfections: {error}") from None


@public
def _checked(
    delay: Mapping[str, int] = NOTHING,
    noise: Mapping[str, float] = NOTHING,
    quantise: Mapping[str, float] = NOTHING,
    missing: Mapping[str, float] = NOTHING,
    mask: bool = False,
    seed: int = 0,
) -> Imperfections:
    kinds = (delay, noise, quantise, missing)
    for (name, (least, most, expected, _)), numbers in zip(KINDS.items(), kinds, strict=True):
        for column, number in numbers.items():
            if not least <= number <= most:
                raise UsageError(f"{name}: {column}: found {number}, expected {expected}")
    if not 0 <= seed < 2**64:
        raise UsageError(f"seed: found {seed}, expected a whole number in [0, 2^64)")
    noise, quantise, missing = ({name: float(x) for name, x in kind.items()} for kind in kinds[1:])
    return Imperfections(delay, noise, quantise, missing, mask, seed)
