"""The content root, one hash that names a dataset's content, and the digests of episodes below it.

    episode digest = SHA-256(steps, then each column but `episode` in order, as little-endian bytes)
    content root   = SHA-256(column names and types, then (cell, index in the cell, digest) sorted)

Neither depends on files, shards, encodings, the running number of an episode, or the order of cells.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

import numpy.typing as npt
import pyarrow as pa

Values = npt.NDArray[Any] | list[bytes]


def episode_digests(runs: list[Values], lengths: list[int]) -> list[bytes]:
    """The digests of whole episodes.

    Args:
        runs: All columns except `episode`, in order. Neighbouring columns of one type form one array
            (columns, rows). A text column, which is constant within an episode, is a list with the `text` of
            each episode.
        lengths: The steps of each episode, in order.
    """
    runs = [
        run if isinstance(run, list) else run.astype(run.dtype.newbyteorder("<"), copy=False) for run in runs
    ]
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
    """Encode a text for a digest: its length in bytes, then its UTF-8 bytes."""
    encoded = value.encode()
    return len(encoded).to_bytes(8, "little") + encoded


def content_root(described: Iterable[tuple[str, str]], episodes: Iterable[tuple[bytes, int, bytes]]) -> str:
    """The content root of a dataset.

    Args:
        described: Name and type of each column, in order.
        episodes: Cell digest, index in the cell and episode digest of each episode, in any order.

    Returns:
        A SHA-256 in hex.
    """
    hasher = hashlib.sha256()
    for name, dtype in described:
        if name != "episode":
            hasher.update(f"{name}:{dtype}\n".encode())
    for cell, index, digest in sorted(episodes):
        hasher.update(cell + index.to_bytes(8, "little") + digest)
    return hasher.hexdigest()


def identity(episodes: pa.Table) -> str:
    """A hash of the contents and the numbers of episodes, whose order a content root does not tell."""
    numbers_and_digests = list(
        zip(episodes["episode"].to_pylist(), episodes["digest"].to_pylist(), strict=True)
    )
    return hashlib.sha256(repr(numbers_and_digests).encode()).hexdigest()
