"""Statistics of columns that can be merged: moments, and quantiles of an evenly spaced sample of rows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from ibdata.dataset.models import Quantile, Statistic
from ibdata.numerics.compiled import compiled

Floats = npt.NDArray[np.float64]
Ranks = npt.NDArray[np.int64]
Table = npt.NDArray[Any]  # (columns, rows), float32 or float64

SAMPLE_ROWS = 100_000  # of a dataset
SAMPLE_LEAST = 200  # of a shard, so that small splits have some
BLOCK = 1024  # values that are summed at a time; a multiple of 4
CLOSE = 1e-9  # a share of the weights that may be rounding
QUANTILES = tuple(float(q) for q in get_args(Quantile))


class Moments(NamedTuple):
    """Number of rows; mean, sum of squared deviations, min and max of each column (columns,)."""

    rows: int
    mean: Floats
    squares: Floats
    low: Floats
    high: Floats


def moments(table: Table) -> Moments:
    """The moments of a table (columns, rows), summed in a fixed order; NaN if it has no rows."""
    mean, squares, low, high = (np.full(len(table), np.nan) for _ in range(4))
    if table.shape[1]:
        for c, x in enumerate(table):
            first = np.float64(x[0])  # subtracted first, so that a constant column has no spread
            mean[c] = first + _summed(x, first, False) / len(x)
            squares[c] = _summed(x, mean[c], True)
            low[c], high[c] = x.min(), x.max()
        odd = np.isnan(squares)  # of a column with infinite values
        low[odd] = high[odd] = np.nan
    return Moments(table.shape[1], mean, squares, low, high)


def merged(a: Moments, b: Moments) -> Moments:
    """Merge the moments of two sets of rows (Chan, Golub and LeVeque 1983)."""
    rows = a.rows + b.rows
    delta = b.mean - a.mean
    return Moments(
        rows,
        a.mean + delta * (b.rows / rows),
        a.squares + b.squares + delta * delta * (a.rows * (b.rows / rows)),
        np.minimum(a.low, b.low),
        np.maximum(a.high, b.high),
    )


def sample_stride(rows: int, total: int) -> int:
    """The distance between sampled rows in a shard of `rows` rows, in a dataset of `total` rows.

    It is 1 if the dataset has at most SAMPLE_ROWS rows, and otherwise an odd number.

    >>> sample_stride(10_000, 10_000), sample_stride(1_000_000, 1_000_000), sample_stride(1000, 10**9)
    (1, 11, 5)
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
        self._samples: list[Table] = []

    def add(self, table: Table) -> Moments:
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
    def sample(self) -> Table:
        """The sample."""
        return self._samples[0] if len(self._samples) == 1 else np.concatenate(self._samples, axis=1)


def of_batches(batches: Iterable[Any], names: Sequence[str], rows: int) -> dict[str, Statistic]:
    """The statistics of Arrow batches, which have these columns and so many rows in all."""
    statistics = RowStatistics(rows, rows)
    for batch in batches:
        statistics.add(np.stack([column.to_numpy() for column in batch.columns]))
    return described(names, statistics.moments, [statistics.sample], [rows])


def described(
    names: Sequence[str],
    parts: Moments,
    samples: list[Table],
    rows: list[int],
    likely: Mapping[str, Statistic] | None = None,
) -> dict[str, Statistic]:
    """Count, mean, std (of the population), min, max and quantiles of each column, as plain numbers.

    A sample stands for all rows of its shard. A value that is not finite becomes None. Quantiles that are
    `likely`, as those of a file are, are tried first: that is faster than to find them.
    """
    sample = np.concatenate(samples, axis=1)
    weights = np.concatenate(
        [np.full(s.shape[1], n / s.shape[1]) for s, n in zip(samples, rows, strict=True)]
    )
    weighted = None if weights.min() == weights.max() else weights
    ranks = np.quantile(np.arange(sample.shape[1]), QUANTILES, method="inverted_cdf").astype(np.int64)
    tried = [_in_order(likely[name].quantiles if likely and name in likely else {}) for name in names]
    columns = zip(sample, tried, strict=True)
    quantiles = np.stack([_quantiles(x, weighted, ranks, near) for x, near in columns], axis=1)
    return {
        name: Statistic(
            count=parts.rows,
            mean=_number(parts.mean[i]),
            std=_number(np.sqrt(parts.squares[i] / parts.rows)),
            min=_number(parts.low[i]),
            max=_number(parts.high[i]),
            quantiles=dict(zip(get_args(Quantile), map(_number, quantiles[:, i]), strict=True)),
        )
        for i, name in enumerate(names)
    }


def _in_order(quantiles: Mapping[Quantile, float | None]) -> Floats:
    return np.array([quantiles.get(q) for q in get_args(Quantile)], dtype=np.float64)


def _quantiles(x: Table, weights: Floats | None, ranks: Ranks, likely: Floats) -> npt.NDArray[Any]:
    """The QUANTILES of a column of a sample, whose order may change; each is a value of the sample."""
    with np.errstate(over="ignore"):
        likely = likely.astype(x.dtype)
    if _are_quantiles(x, weights, ranks, likely):
        return likely
    if weights is not None:
        weighted: npt.NDArray[Any] = np.quantile(
            x.astype(np.float64), QUANTILES, weights=weights, method="inverted_cdf"
        )
        return weighted
    x.partition(ranks)  # much faster than np.quantile
    return np.where(np.isnan(x).any(), np.nan, x[ranks])


def _are_quantiles(x: Table, weights: Floats | None, ranks: Ranks, likely: npt.NDArray[Any]) -> bool:
    """Whether numbers are surely the quantiles of a column: the weight below each and up to it says so."""
    if np.isnan(likely).any() or np.isnan(x).any():
        return False
    if weights is None:
        of_ranks = zip(likely, ranks, strict=True)
        return all(np.count_nonzero(x < v) <= rank < np.count_nonzero(x <= v) for v, rank in of_ranks)
    total = weights.sum()
    bounds = zip(likely, (q * total for q in QUANTILES), strict=True)
    return all(
        weights @ (x < v) < w - CLOSE * total and w + CLOSE * total < weights @ (x <= v) for v, w in bounds
    )


def _number(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


def sums(rows: Table, lengths: int) -> Floats:
    """The sum of each run of `lengths` values of a column (rows,), in a fixed order."""
    return np.cumsum(rows.reshape(-1, lengths), axis=1, dtype=np.float64)[:, -1].copy()


@compiled
def _summed(x: Table, o: float, squared: bool) -> float:
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
