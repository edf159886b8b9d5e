"""Whether a shard keeps every rule, and holds what the metadata say of it."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ibdata.dataset.digest import episode_digests, table_runs
from ibdata.dataset.frame import Frame, columns_of
from ibdata.dataset.rules import RULES, Problem, Rows

THREADS = os.cpu_count() or 1


def check_shard(
    table: pa.Table,
    frame: Frame,
    shard: dict[str, Any],
    info: dict[str, Any],
    episodes: pa.Table,
    ranges: dict[str, tuple[float, float]],
) -> Iterator[Problem]:
    """Every rule of the rows of a shard, given its part of the table of episodes, and ranges of columns.

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
        ranges,
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
