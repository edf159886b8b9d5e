"""What must hold of the rows of a shard; each rule yields (row, message) for what it finds broken."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from ibdata.dataset.digest import episode_digests, table_runs
from ibdata.dataset.frame import Frame, columns_of

Array = npt.NDArray[Any]
Found = Iterator[tuple[int, str]]
THREADS = os.cpu_count() or 1


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

    def group(self, role: str) -> list[str]:
        """The names of the columns with a role."""
        return [column["name"] for column in self.described if column["role"] == role]


def finite(rows: Rows) -> Found:
    """Every float is finite; action_log_prob may be NaN, where a custom policy knows no density."""
    for column in rows.described:
        if column["dtype"].startswith("float") and column["role"] != "log_prob":
            yield from _where(
                ~np.isfinite(rows.columns[column["name"]]), column["name"], rows, "a finite number"
            )


def bounds(rows: Rows) -> Found:
    """Every number lies within the bounds that info.json gives its column."""
    for column in rows.described:
        if column["dtype"] in ("bool", "string"):
            continue
        values, low, high = rows.columns[column["name"]], column["low"], column["high"]
        if low is not None:
            yield from _where(values < low, column["name"], rows, f"at least {low:g}")
        if high is not None:
            yield from _where(values > high, column["name"], rows, f"at most {high:g}")


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


def check_shard(
    table: pa.Table, frame: Frame, shard: dict[str, Any], info: dict[str, Any], episodes: pa.Table
) -> Iterator[Problem]:
    """Every rule of the rows of a shard, given its part of the table of episodes.

    Digests are computed in other threads meanwhile; hashing lets go of Python's lock.
    """
    lengths = episodes["length"].to_numpy()
    if table.num_rows != lengths.sum() or table.num_rows != shard["rows"]:
        message = f"found {table.num_rows}, expected {shard['rows']} rows of whole episodes"
        yield Problem(shard["path"], None, "rows", message)
        return
    rows = Rows(
        columns_of(frame),
        info["columns"],
        np.cumsum(lengths) - lengths,
        lengths,
        episodes["episode"].to_numpy(),
        episodes["setpoint"].to_numpy(),
        info["drifting"],
    )
    with ThreadPoolExecutor(THREADS) as threads:
        digesting = _digesting(threads, table, frame, rows)
        for name, rule in RULES.items():
            for row, message in rule(rows):
                yield Problem(shard["path"], row, name, message)
        yield from _labels(table, shard, rows, episodes)
        digests = [digest for future in digesting for digest in future.result()]
    yield from _digests_and_returns(digests, shard, rows, episodes)


def _digesting(
    threads: ThreadPoolExecutor, table: pa.Table, frame: Frame, rows: Rows
) -> list[Future[list[bytes]]]:
    """The digests of the episodes, in parts that threads work at."""
    futures = []
    for part in np.array_split(np.arange(len(rows.starts)), THREADS):
        if len(part):
            start, lengths = rows.starts[part[0]], rows.lengths[part].tolist()
            stop = int(start + sum(lengths))
            own: Frame = [(names, v if v is None else v[:, start:stop]) for names, v in frame]
            futures.append(
                threads.submit(episode_digests, table_runs(own, table, rows.starts[part].tolist()), lengths)
            )
    return futures


def _labels(table: pa.Table, shard: dict[str, Any], rows: Rows, episodes: pa.Table) -> Iterator[Problem]:
    """The policy of every row is that of its episode; both as numbers of their texts."""
    policy = pc.dictionary_encode(pa.chunked_array(table["policy"]).cast(pa.string()))
    policy = policy.combine_chunks() if isinstance(policy, pa.ChunkedArray) else policy
    number = {text: i for i, text in enumerate(policy.dictionary.to_pylist())}
    own = episodes["policy"].to_pylist()
    expected = np.repeat([number.get(text, -1) for text in own], rows.lengths)
    found = policy.indices.to_numpy()
    if (found != expected).any():
        row = int(np.argmax(found != expected))
        label = own[int(np.searchsorted(rows.starts, row, side="right")) - 1]
        message = f"found {policy[row].as_py()}, expected {label}"
        yield Problem(shard["path"], row, "policy", message)


def _digests_and_returns(
    digests: list[bytes], shard: dict[str, Any], rows: Rows, episodes: pa.Table
) -> Iterator[Problem]:
    starts = rows.starts.tolist()
    for start, digest, expected in zip(starts, digests, episodes["digest"].to_pylist(), strict=True):
        if digest != expected:
            yield Problem(shard["path"], start, "digest", "found other content than episodes.parquet lists")
    if hashlib.sha256(b"".join(digests)).hexdigest() != shard["content"]:
        yield Problem(shard["path"], None, "digest", "found other content than the manifest lists")
    returns = np.add.reduceat(rows.columns["reward"].astype(np.float64), rows.starts)
    wrong = ~np.isclose(returns, episodes["return"].to_numpy(), rtol=1e-9, atol=1e-9)
    if wrong.any():
        row = starts[int(np.argmax(wrong))]
        yield Problem(
            shard["path"], row, "return", "found another sum of rewards than episodes.parquet lists"
        )


def _where(broken: Array, name: str, rows: Rows, expected: str) -> Found:
    """The first broken row of a column, and how many more there are."""
    count = int(np.count_nonzero(broken))
    if count:
        row = int(np.argmax(broken))
        more = f" ({count} such rows)" if count > 1 else ""
        yield row, f"{name}: found {rows.columns[name][row]}, expected {expected}{more}"
