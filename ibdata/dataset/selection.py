"""The episodes of a dataset that are to be read: those of a split, at some setpoints, of some policies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata.errors import UsageError, suggestion
from ibdata.numerics.naming import exact

Runs = list[tuple[int, int]]
Mask = npt.NDArray[np.bool_]
Columns = Sequence[str] | None
Split = str | None
Setpoint = float | Sequence[float] | npt.NDArray[Any] | None
Policy = str | Sequence[str] | None
MOST_NAMES = 40  # in a message


def selected(
    episodes: pa.Table, split: Sequence[Sequence[int]] | None, setpoint: Setpoint, policy: Policy
) -> Mask:
    """Whether each episode is in the runs [first, stop] of a split, at a setpoint, and of a policy.

    Raises UsageError if the dataset has no such setpoint or policy.
    """
    inside = np.full(len(episodes), split is None)
    for first, stop in split or ():
        inside[first:stop] = True
    if setpoint is not None:
        values = episodes["setpoint"].to_numpy()
        inside &= np.isin(values, known_of("setpoint", setpoint, np.unique(values).tolist()))
    if policy is not None:
        labels = episodes["policy"].combine_chunks()
        names = labels.dictionary.to_pylist()
        chosen = known_of("policy", policy, names)
        inside &= np.isin(labels.indices.to_numpy(), [names.index(name) for name in chosen])
    return inside


def rows_of(episodes: pa.Table, inside: Mask) -> dict[int, Runs]:
    """The rows of the selected episodes in each shard, as runs start … stop - 1."""
    found: dict[int, Runs] = {}
    columns = (episodes[name].to_numpy()[inside].tolist() for name in ("shard", "row_start", "row_stop"))
    for shard, start, stop in zip(*columns, strict=True):
        own = found.setdefault(shard, [])
        if own and own[-1][1] == start:
            start = own.pop()[0]
        own.append((start, stop))
    return found


def rows_in(batches: Iterable[pa.RecordBatch], runs: Runs | None) -> Iterator[pa.RecordBatch]:
    """The rows of a shard that are in the runs, or all of them, from its batches in order."""
    first = 0
    for batch in batches:
        stop = first + batch.num_rows
        for start, end in [(first, stop)] if runs is None else runs:
            low, high = max(start, first), min(end, stop)
            if low < high:
                yield batch.slice(low - first, high - low)
        first = stop


def known_of(what: str, given: Any, known: Sequence[Any]) -> list[Any]:
    """One or several names or numbers as a list. Raises UsageError for one that is not known.

    >>> known_of("setpoint", 70, [20.0, 70.0]), known_of("policy", ["safe"], ["random", "safe"])
    ([70], ['safe'])
    """
    wanted = list(given) if np.ndim(given) else [given]
    for value in wanted:
        if value not in known:
            raise UsageError(f"{what}: found {_shown(value)}, expected {_one_of(value, known)}")
    return wanted


def _one_of(value: Any, known: Sequence[Any]) -> str:
    """The known names, and the one that is similar to the value."""
    names = [_shown(each).strip("'") for each in known]
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    near = suggestion(_shown(value).strip("'"), names)
    return f"one of {', '.join(names[:MOST_NAMES])}{more}{near}"


def _shown(value: Any) -> str:
    return exact(float(value)) if isinstance(value, Real) else repr(value)
