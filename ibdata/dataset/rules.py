"""What must hold of the rows of a shard; each rule yields (row, message) for what it finds broken."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa

Array = npt.NDArray[Any]
Found = Iterator[tuple[int, str]]


class Problem(NamedTuple):
    """One broken rule: the file, the row in it if there is one, the rule, what was found and expected."""

    path: str
    row: int | None
    rule: str
    message: str

    def __str__(self) -> str:
        place = self.path if self.row is None else f"{self.path}: row {self.row}"
        return f"{place}: {self.rule}: {self.message}"


class Rows(NamedTuple):
    """A shard's columns, and its episodes as their first row and length."""

    columns: dict[str, Array]
    described: list[dict[str, Any]]
    starts: Array
    lengths: Array
    episodes: Array
    setpoints: Array
    drifting: bool
    ranges: dict[str, tuple[float, float]]  # of the columns of floats that are finite

    def group(self, role: str) -> list[str]:
        """The names of the columns with a role."""
        return [column["name"] for column in self.described if column["role"] == role]


def finite(rows: Rows) -> Found:
    """Every float is finite; action_log_prob may be NaN, where a custom policy knows no density."""
    for column in rows.described:
        name = column["name"]
        if column["dtype"].startswith("float") and column["role"] != "log_prob" and name not in rows.ranges:
            yield from _where(~np.isfinite(rows.columns[name]), name, rows, "a finite number")


def bounds(rows: Rows) -> Found:
    """Every number lies within the bounds that info.json gives its column."""
    for column in rows.described:
        if column["dtype"] in ("bool", "string"):
            continue
        name, low, high = column["name"], column["low"], column["high"]
        least, greatest = rows.ranges.get(name, (-np.inf, np.inf))
        if low is not None and least < low:
            yield from _where(rows.columns[name] < low, name, rows, f"at least {low:g}")
        if high is not None and greatest > high:
            yield from _where(rows.columns[name] > high, name, rows, f"at most {high:g}")


def indices(rows: Rows) -> Found:
    """Episodes follow each other whole, and steps count from 0 within each."""
    episode = np.repeat(rows.episodes, rows.lengths)
    step = np.arange(len(episode)) - np.repeat(rows.starts, rows.lengths)
    yield from _where(rows.columns["episode"] != episode, "episode", rows, "the episode of episodes.parquet")
    yield from _where(rows.columns["step"] != step, "step", rows, "steps from 0 within each episode")


def flags(rows: Rows) -> Found:
    """terminated is never set; truncated is set on the last row of an episode, and there only."""
    last = np.zeros(len(rows.columns["truncated"]), dtype=np.bool_)
    last[rows.starts + rows.lengths - 1] = True
    yield from _where(rows.columns["terminated"], "terminated", rows, "false")
    yield from _where(rows.columns["truncated"] != last, "truncated", rows, "true on last rows only")


def continuity(rows: Rows) -> Found:
    """What is said of t + 1 in one row is said of t in the next row of the episode."""
    inner = np.ones(len(rows.columns["step"]) - 1, dtype=np.bool_)
    inner[rows.starts[1:] - 1] = False
    for name in rows.group("next_observation") + rows.group("next_latent"):
        after, now = rows.columns[name][:-1], rows.columns[name.removeprefix("next_")][1:]
        yield from _where((after != now) & inner, name, rows, "the next row's value at t")


def reward(rows: Rows) -> Found:
    """reward = -c - 3 f of the next observation, but for the rounding of float32."""
    c, f, r = (
        rows.columns[name].astype(np.float64)
        for name in ("next_obs_consumption", "next_obs_fatigue", "reward")
    )
    tolerance = 2.0**-23 * (np.abs(c) + 3.0 * np.abs(f) + np.abs(r))
    yield from _where(
        np.abs(r + c + 3.0 * f) > tolerance, "reward", rows, "-consumption - 3 fatigue at t + 1"
    )


def setpoint(rows: Rows) -> Found:
    """A constant setpoint is the one that episodes.parquet gives the episode."""
    if rows.drifting:
        return
    expected = np.repeat(rows.setpoints, rows.lengths).astype(rows.columns["obs_setpoint"].dtype)
    yield from _where(
        rows.columns["obs_setpoint"] != expected, "obs_setpoint", rows, "the episode's setpoint"
    )


RULES: dict[str, Callable[[Rows], Found]] = {
    rule.__name__: rule for rule in (finite, bounds, indices, flags, continuity, reward, setpoint)
}


def nulls(table: pa.Table) -> Found:
    """No value is missing."""
    for name in table.column_names:
        if table[name].null_count:
            row = int(np.argmax(table[name].is_null().to_numpy()))
            yield row, f"{name}: found no value, expected one"


def _where(broken: Array, name: str, rows: Rows, expected: str) -> Found:
    """The first broken row of a column, and how many more there are."""
    count = int(np.count_nonzero(broken))
    if count:
        row = int(np.argmax(broken))
        more = f" ({count} such rows)" if count > 1 else ""
        yield row, f"{name}: found {rows.columns[name][row]}, expected {expected}{more}"
