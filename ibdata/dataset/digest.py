"""The name of a dataset's content: digests of episodes, and one root over them.

    episode digest = SHA-256(steps, then each column but `episode` in order, as little-endian bytes)
    content root   = SHA-256(column names and types, then (cell, index in the cell, digest) sorted)

Neither depends on files, shards, encodings, the running number of an episode, or the order of cells.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

import numpy.typing as npt

Run = npt.NDArray[Any] | list[bytes]


def episode_digests(runs: list[Run], lengths: list[int]) -> list[bytes]:
    """The digest of each episode of columns whose rows are whole episodes of these lengths, in order.

    runs are the columns but `episode` in their order, those of one type that follow each other as one
    array (columns, rows). A text column is constant within an episode and is one `text` an episode.
    """
    runs = [run if isinstance(run, list) else _little_endian(run) for run in runs]
    digests = []
    row = 0
    for i, length in enumerate(lengths):
        hasher = hashlib.sha256(length.to_bytes(8, "little"))
        for run in runs:
            hasher.update(run[i] if isinstance(run, list) else run[:, row : row + length].tobytes())
        digests.append(hasher.digest())
        row += length
    return digests


def text(value: str) -> bytes:
    """A text as it enters a digest: its length in bytes, then its UTF-8 bytes."""
    encoded = value.encode()
    return len(encoded).to_bytes(8, "little") + encoded


def _little_endian(run: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return run.astype(run.dtype.newbyteorder("<"), copy=False)


def content_root(described: Iterable[tuple[str, str]], episodes: Iterable[tuple[bytes, int, bytes]]) -> str:
    """The hex root over names and types of columns, and (cell digest, index in the cell, episode digest)."""
    hasher = hashlib.sha256()
    for name, dtype in described:
        if name != "episode":
            hasher.update(f"{name}:{dtype}\n".encode())
    for cell, index, digest in sorted(episodes):
        hasher.update(cell + index.to_bytes(8, "little") + digest)
    return hasher.hexdigest()
