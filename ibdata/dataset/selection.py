"""Which episodes and rows are read: what a user says of them, and which ones meet it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arrays import Ints
from ibdata._numerics.naming import decimal, exact
from ibdata.dataset.models import Info
from ibdata.dataset.stored import Mask, Stored
from ibdata.errors import UsageError, excerpt, suggestion


def whole_numbers(what: str, value: Any) -> Ints:
    """Whole numbers (n,) from a number or an array, which may be empty."""
    numbers = np.asarray(value)
    if numbers.size == 0:
        numbers = numbers.astype(np.int64)  # whatever its type, as that of []
    if numbers.dtype.kind not in "iu" or numbers.ndim > 1:
        raise UsageError(f"{what}: found {excerpt(value)}, expected whole numbers")
    return np.atleast_1d(numbers).astype(np.int64)


def numbers_within(what: str, value: Any, count: int) -> Ints:
    """Whole numbers (n,) from 0 to count - 1."""
    numbers = whole_numbers(what, value)
    wrong = (numbers < 0) | (numbers >= count)
    if wrong.any():
        raise UsageError(f"{what}: found {numbers[np.argmax(wrong)]}, expected one of 0 to {count - 1}")
    return numbers


ColumnsArg = Sequence[str] | None
SplitArg = str | Sequence[str] | None
SetpointArg = float | Sequence[float] | npt.NDArray[Any] | None
PolicyArg = str | Sequence[str] | None
EpisodesArg = int | Sequence[int] | npt.NDArray[Any] | None  # of episodes
ReturnsArg = tuple[float | None, float | None] | None  # lowest and highest; None where there is no limit
MOST_NAMES = 40  # in a message


def known_of(what: str, names: Any, known: Sequence[Any]) -> list[Any]:
    """One or several names or numbers as a list. Raises UsageError for one that is not known.

    >>> known_of("setpoint", 70, [20.0, 70.0]), known_of("policy", ["safe"], ["random", "safe"])
    ([70], ['safe'])
    """
    values = list(names) if np.ndim(names) else [names]
    members = set(known)  # of which there may be thousands
    for value in values:
        if value not in members:
            raise UsageError(f"{what}: found {_shown(value)}{_expected(value, known)}")
    return values


def _expected(value: Any, known: Sequence[Any]) -> str:
    """The known name that is similar to a name; else the known ones."""
    names = [_shown(name).strip("'") for name in known]
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    near = suggestion(value, names) if isinstance(value, str) else ""
    return near or f", expected one of {', '.join(names[:MOST_NAMES])}{more}"


def _shown(value: Any) -> str:
    return exact(value) if isinstance(value, Real) else repr(value)


def checked_columns(columns: ColumnsArg, info: Info) -> list[str]:
    """Names of columns of the dataset, by default all. Raises UsageError for one that it does not have."""
    known = [column.name for column in info.columns]
    if columns is None:
        return known
    if not columns or len(set(columns)) < len(columns):
        raise UsageError(f"columns: found {columns!r}, expected a list of different names")
    return known_of("column", columns, known)


def refuse_columns(columns: ColumnsArg) -> None:
    """Raise UsageError if columns are named beside a view."""
    if columns is not None:
        raise UsageError("columns: found columns beside a view, which has its own; leave one out")


def within_returns(stored: Stored, returns: ReturnsArg) -> Mask | bool:
    """Whether the return of each episode is within the limits. Raises UsageError for invalid ones."""
    if returns is None:
        return True
    lowest, highest = returns if len(returns) == 2 else (math.nan, math.nan)
    low, high = -math.inf if lowest is None else lowest, math.inf if highest is None else highest
    if not low <= high:
        raise UsageError(f"returns: found {returns}, expected the lowest and the highest one")
    values = stored.episodes["return"].to_numpy()
    mask: Mask = (low <= values) & (values <= high)
    return mask


def checked_length(length: int, name: str = "history") -> int:
    """The number of observations in a history, or of steps. Raises UsageError if it is invalid."""
    if length < 1:
        raise UsageError(f"{name}: found {length!r}, expected a whole number of at least 1")
    return length


def checked_history(history: int, pad: str) -> bool:
    """Check both arguments of `Dataset.arrays`; return whether rows without a full history are dropped.

    Raises UsageError if one is invalid.
    """
    checked_length(history)
    if pad not in ("repeat", "drop"):
        raise UsageError(f"pad: found {pad!r}, expected repeat or drop")
    return pad == "drop"


def meeting(
    stored: Stored, split: SplitArg, setpoint: SetpointArg, policy: PolicyArg, numbers: EpisodesArg
) -> Mask:
    """Whether each episode of a dataset meets all conditions that are not None.

    Raises UsageError if the dataset has no such split, setpoint, policy or episode.
    """
    table = stored.episodes
    mask = np.ones(len(table), dtype=np.bool_)
    if split is not None:
        if not stored.splits:
            raise UsageError(f"split: found {split!r}, expected no split: the dataset declares no splits")
        mask &= in_splits(stored, known_of("split", split, list(stored.splits)))
    if setpoint is not None:
        values = table["setpoint"].to_numpy()
        with np.errstate(over="ignore"):  # of the column's type, in which 20.1 is the number nearest to it
            points = np.array(setpoint, values.dtype).ravel()
        known_of("setpoint", list(map(decimal, points)), list(map(decimal, np.unique(values))))
        mask &= np.isin(values, points)
    if policy is not None:
        labels = table["policy"].combine_chunks()
        names = labels.dictionary.to_pylist()
        places = [names.index(name) for name in known_of("policy", policy, names)]
        mask &= np.isin(labels.indices.to_numpy(), places)
    if numbers is not None:
        chosen = np.bincount(numbers_within("episodes", numbers, len(table)), minlength=len(table))
        if chosen.max() > 1:
            raise UsageError(
                f"episodes: found {chosen.argmax()} {chosen.max()} times, expected each number once; for a "
                "bootstrap, draw from the rows that `arrays` gives, by their `episode`"
            )
        mask &= chosen == 1
    return mask


def in_splits(stored: Stored, splits: Sequence[str]) -> Mask:
    """Whether each episode is in one of these splits."""
    mask = np.zeros(len(stored.episodes), dtype=np.bool_)
    for split in splits:
        declared = [shard.episodes for shard in stored.manifest.shards if split in shard.splits]
        for first, stop in [*declared, *stored.splits[split].runs]:
            mask[first:stop] = True
    return mask
