"""Statistics of columns that merge: moments of each part, and quantiles of an even sample of rows."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.columns import Table
from ibdata.compiling import compiled

Floats = npt.NDArray[np.float64]

SAMPLE_ROWS = 100_000
QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)


class Moments(NamedTuple):
    """Number of rows; mean, sum of squared deviations, min and max of each column (columns,)."""

    rows: int
    mean: Floats
    squares: Floats
    low: Floats
    high: Floats


def moments(table: Table) -> Moments:
    """The moments of the rows of a table (columns, rows), summed in a fixed order."""
    mean, squares, low, high = (np.empty(len(table)) for _ in range(4))
    _moments(table, mean, squares, low, high)
    return Moments(table.shape[1], mean, squares, low, high)


def merged(a: Moments, b: Moments) -> Moments:
    """The moments of the rows of both (Chan, Golub and LeVeque 1983)."""
    rows = a.rows + b.rows
    delta = b.mean - a.mean
    return Moments(
        rows,
        a.mean + delta * (b.rows / rows),
        a.squares + b.squares + delta * delta * (a.rows * (b.rows / rows)),
        np.minimum(a.low, b.low),
        np.maximum(a.high, b.high),
    )


def sample_stride(rows: int) -> int:
    """The distance of sampled rows: 1 up to SAMPLE_ROWS rows, beyond that an odd number.

    >>> sample_stride(10_000), sample_stride(1_000_000)
    (1, 11)
    """
    return 1 if rows <= SAMPLE_ROWS else (-(-rows // SAMPLE_ROWS)) | 1


def described(names: tuple[str, ...], parts: Moments, sample: Table) -> dict[str, dict[str, Any]]:
    """count, mean, std (of the population), min, max and quantiles of each column, as plain numbers."""
    quantiles = np.quantile(sample.astype(np.float64), QUANTILES, axis=1, method="lower")
    return {
        name: {
            "count": parts.rows,
            "mean": float(parts.mean[i]),
            "std": float(np.sqrt(parts.squares[i] / parts.rows)),
            "min": float(parts.low[i]),
            "max": float(parts.high[i]),
            "quantiles": {f"{q:g}": float(x) for q, x in zip(QUANTILES, quantiles[:, i], strict=True)},
        }
        for i, name in enumerate(names)
    }


def sums(rows: Table, lengths: int) -> Floats:
    """The sum of every `lengths` values of a column (rows,), in a fixed order."""
    out = np.empty(len(rows) // lengths)
    _sums(rows, lengths, out)
    return out


@compiled
def _moments(table: Table, mean: Floats, squares: Floats, low: Floats, high: Floats) -> None:
    n = table.shape[1]
    for c in range(table.shape[0]):
        x = table[c]
        s0 = s1 = s2 = s3 = 0.0
        least = greatest = x[0]
        whole = n - n % 4
        for i in range(0, whole, 4):
            s0, s1, s2, s3 = s0 + x[i], s1 + x[i + 1], s2 + x[i + 2], s3 + x[i + 3]
        for i in range(n):
            least = min(least, x[i])
            greatest = max(greatest, x[i])
        for i in range(whole, n):
            s0 = s0 + x[i]
        m = ((s0 + s1) + (s2 + s3)) / n
        s0 = s1 = s2 = s3 = 0.0
        for i in range(0, whole, 4):
            d0, d1, d2, d3 = x[i] - m, x[i + 1] - m, x[i + 2] - m, x[i + 3] - m
            s0, s1, s2, s3 = s0 + d0 * d0, s1 + d1 * d1, s2 + d2 * d2, s3 + d3 * d3
        for i in range(whole, n):
            s0 = s0 + (x[i] - m) * (x[i] - m)
        mean[c], squares[c], low[c], high[c] = m, (s0 + s1) + (s2 + s3), least, greatest


@compiled
def _sums(rows: Table, length: int, out: Floats) -> None:
    for e in range(out.shape[0]):
        total = 0.0
        for t in range(length):
            total += rows[e * length + t]
        out[e] = total
