"""Statistics of columns that can be merged: moments, and quantiles of an evenly spaced sample of rows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arrays import Floats
from ibdata._numerics.compiled import compiled
from ibdata.dataset.models import Quantile, Statistic

Matrix = npt.NDArray[Any]  # (columns, rows), float32 or float64

SAMPLE_ROWS = 50_000  # of a dataset
SAMPLE_LEAST = 200  # of a shard, so that small splits have some
BLOCK = 1024  # values that are summed at a time; a multiple of 4
QUANTILES = tuple(float(q) for q in get_args(Quantile))


class Moments(NamedTuple):
    """Number of rows; of the finite values of each column mean, squared deviations, min, max and count."""

    rows: int
    mean: Floats
    squares: Floats
    low: Floats
    high: Floats
    counts: npt.NDArray[np.int64]


def moments(table: Matrix) -> Moments:
    """The moments of rows (columns, rows), summed in a fixed order."""
    found = []
    for x in table:
        of_column = _moments(x)
        if np.isnan(of_column[1]):  # of a column with values that are not finite
            of_column = _moments(x[np.isfinite(x)])
        found.append(of_column)
    mean, squares, low, high = (np.array([column[i] for column in found]) for i in range(4))
    return Moments(
        table.shape[1], mean, squares, low, high, np.array([column[4] for column in found], np.int64)
    )


def _moments(x: Matrix) -> tuple[float, float, float, float, int]:
    """The moments of a column (rows,). Those of no rows change no others that they are merged with."""
    if not len(x):
        return 0.0, 0.0, np.inf, -np.inf, 0
    first = np.float64(x[0])  # subtracted first, so that a constant column has no spread
    mean = first + _summed(x, first, False) / len(x)
    return mean, _summed(x, mean, True), float(x.min()), float(x.max()), len(x)


def merged(a: Moments, b: Moments) -> Moments:
    """Merge the moments of two sets of rows (Chan, Golub and LeVeque 1983)."""
    counts = a.counts + b.counts
    delta, share = b.mean - a.mean, b.counts / np.maximum(counts, 1)
    return Moments(
        a.rows + b.rows,
        a.mean + delta * share,
        a.squares + b.squares + delta * delta * (a.counts * share),
        np.minimum(a.low, b.low),
        np.maximum(a.high, b.high),
        counts,
    )


def sample_stride(rows: int, total: int) -> int:
    """The distance between sampled rows in a shard of `rows` rows, in a dataset of `total` rows.

    It is 1 if the dataset has at most SAMPLE_ROWS rows, and otherwise an odd number.

    >>> sample_stride(10_000, 10_000), sample_stride(1_000_000, 1_000_000), sample_stride(1000, 10**9)
    (1, 21, 5)
    """
    if total <= SAMPLE_ROWS:
        return 1
    return -(-rows // max(SAMPLE_LEAST, SAMPLE_ROWS * rows // total)) | 1


class RowStatistics:
    """Moments and an evenly spaced sample of the rows of a shard or a split, which are added in parts.

    Args:
        rows: The number of rows that will be added.
        total: The number of rows of the dataset.
    """

    def __init__(self, rows: int, total: int) -> None:
        self._stride, self._seen = sample_stride(rows, total), 0
        self._moments: Moments | None = None
        self._samples: list[Matrix] = []

    def add(self, table: Matrix) -> Moments:
        """Add rows; return their moments."""
        part = moments(np.ascontiguousarray(table))
        self._moments = part if self._moments is None else merged(self._moments, part)
        self._samples.append(table[:, -self._seen % self._stride :: self._stride].copy())
        self._seen += table.shape[1]
        return part

    @property
    def moments(self) -> Moments:
        """The moments of all rows."""
        assert self._moments is not None
        return self._moments

    @property
    def sample(self) -> Matrix:
        """The sample."""
        return self._samples[0] if len(self._samples) == 1 else np.concatenate(self._samples, axis=1)


def of_batches(batches: Iterable[Any], names: Sequence[str], rows: int) -> dict[str, Statistic]:
    """The statistics of Arrow batches, which have these columns and so many rows in all."""
    statistics = RowStatistics(rows, rows)
    for batch in batches:
        statistics.add(np.stack([column.to_numpy() for column in batch.columns]))
    return statistics_of_columns(names, statistics.moments, [statistics.sample], [rows])


def statistics_of_columns(
    names: Sequence[str], parts: Moments, samples: list[Matrix], rows: list[int]
) -> dict[str, Statistic]:
    """Count, mean, std (of the population), min, max and quantiles of each column, as plain numbers.

    They are those of its finite values, and None if it has none. A sample stands for all rows of its shard.
    """
    sample = np.concatenate(samples, axis=1)
    weights = np.concatenate(
        [np.full(s.shape[1], n / s.shape[1]) for s, n in zip(samples, rows, strict=True)]
    )
    quantiles = _quantiles(sample, None if weights.min() == weights.max() else weights)
    counts = np.where(parts.counts > 0, parts.counts, np.nan)
    mean, std = np.where(parts.counts > 0, parts.mean, np.nan), np.sqrt(parts.squares / counts)
    return {
        name: Statistic(
            count=int(parts.counts[i]),
            mean=_number(mean[i]),
            std=_number(std[i]),
            min=_number(parts.low[i]),
            max=_number(parts.high[i]),
            quantiles=dict(zip(get_args(Quantile), map(_number, quantiles[:, i]), strict=True)),
        )
        for i, name in enumerate(names)
    }


def _quantiles(sample: Matrix, weights: Floats | None) -> npt.NDArray[Any]:
    """The QUANTILES (quantiles, columns) of a sample, which may be reordered; each is a value of it."""
    finite = np.isfinite(sample)
    if not finite.all():
        parts = [(x[np.newaxis, known], known) for x, known in zip(sample, finite, strict=True)]
        some = (_quantiles(x, None if weights is None else weights[known]) for x, known in parts)
        return np.concatenate(list(some), axis=1)
    if not sample.size:
        return np.full((len(QUANTILES), len(sample)), np.nan)
    if weights is not None:
        quantiles: npt.NDArray[Any] = np.quantile(
            sample.astype(np.float64), QUANTILES, axis=1, weights=weights, method="inverted_cdf"
        )
        return quantiles
    ranks = np.quantile(np.arange(sample.shape[1]), QUANTILES, method="inverted_cdf").astype(np.int64)
    sample.partition(ranks, axis=1)  # much faster than np.quantile
    return sample[:, ranks].T


def _number(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


def sums(rows: Matrix, lengths: int) -> Floats:
    """The sum of each run of `lengths` values of a column (rows,), in a fixed order."""
    return np.cumsum(rows.reshape(-1, lengths), axis=1, dtype=np.float64)[:, -1].copy()


@compiled
def _summed(x: Matrix, o: float, squared: bool) -> float:
    """The sum of x - o, or of its square. The differences come first, because that loop is vectorized."""
    d = np.empty(BLOCK)
    s0 = s1 = s2 = s3 = 0.0
    for start in range(0, len(x), BLOCK):
        part = x[start : start + BLOCK]
        for i in range(len(part)):
            d[i] = part[i] - o
        if squared:
            for i in range(len(part)):
                d[i] = d[i] * d[i]
        whole = len(part) - len(part) % 4
        for i in range(0, whole, 4):
            s0, s1, s2, s3 = s0 + d[i], s1 + d[i + 1], s2 + d[i + 2], s3 + d[i + 3]
        for i in range(whole, len(part)):
            s0 = s0 + d[i]
    return (s0 + s1) + (s2 + s3)
