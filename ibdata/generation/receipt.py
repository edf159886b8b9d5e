"""Receipts of the shards that a run has finished, from which it goes on and makes the metadata.

A receipt holds the entry of the shard's file and a summary of its rows: arrays, one after the other.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.dataset.statistics import Moments
from ibdata.errors import IbdataError
from ibdata.experiment.plan import Shard
from ibdata.system.files import FileEntry, file_sha256, new_file
from ibdata.system.part import RECEIPTS
from ibdata.writing.shard_writer import WrittenShard
from ibdata.writing.summary import ShardSummary

DATASET = "dataset"  # the folder of a part that holds the dataset
MOST = 8  # numbers of shards in a message


def path_of(root: Path, shard: Shard) -> Path:
    """The place of a shard's receipt in a part."""
    return root / RECEIPTS / f"{shard.number:05d}.npy"


def put(root: Path, written: WrittenShard) -> None:
    """Write the receipt of a shard whose file is on the disk."""
    summary = written.content
    known = {"file": list(written.entry), "rows": summary.moments.rows, "clipped": summary.clipped}
    arrays: list[npt.NDArray[Any]] = [
        np.frombuffer(json.dumps(known).encode(), np.uint8),
        np.frombuffer(b"".join(summary.digests), np.uint8).reshape(-1, 32),
        summary.returns,
        *summary.moments[1:],
        summary.sample,
    ]
    path = path_of(root, written.shard)
    path.parent.mkdir(exist_ok=True)
    temporary = root / f".tmp-{secrets.token_hex(6)}-{path.name}"  # hosts may have equal process ids
    with new_file(temporary) as file:
        for array in arrays:
            np.save(file, array)
    temporary.replace(path)


def get(root: Path, shard: Shard) -> WrittenShard | None:
    """Read the receipt of a shard; None if there is none, or if it is damaged."""
    try:
        with path_of(root, shard).open("rb") as file:
            header, digests, returns, mean, squares, low, high, sample = (np.load(file) for _ in range(8))
        known = json.loads(header.tobytes())
        moments = Moments(known["rows"], mean, squares, low, high)
        summary = ShardSummary(list(map(bytes, digests)), returns, moments, sample, known["clipped"])
        return WrittenShard(shard, FileEntry(*known["file"]), summary)
    except (OSError, ValueError, EOFError, KeyError, TypeError):
        return None


def is_whole(root: Path, written: WrittenShard) -> bool:
    """Whether the file of a shard is the one that its receipt says."""
    return file_sha256(root / DATASET / written.entry.path) == written.entry.sha256


def has_size(root: Path, written: WrittenShard) -> bool:
    """Whether the file of a shard has the size that its receipt says; of one that was just written."""
    path = root / DATASET / written.entry.path
    return path.is_file() and path.stat().st_size == written.entry.bytes


def all_of(
    root: Path,
    shards: Sequence[Shard],
    place: Path,
    todo: str,
    is_right: Callable[[Path, WrittenShard], bool] = has_size,
) -> list[WrittenShard]:
    """All these shards, from their receipts.

    Raises IbdataError if the receipt of one cannot be read, or does not fit its file; `todo` is the remedy.
    """
    found = [get(root, shard) for shard in shards]
    whole = [each for each in found if each is not None and is_right(root, each)]
    if len(whole) < len(shards):
        known = {each.shard.number for each in whole}
        lost = [str(shard.number) for shard in shards if shard.number not in known]
        more = f" and {len(lost) - MOST} more" if len(lost) > MOST else ""
        count = f"{len(lost)} of {len(shards)} shards are missing or damaged"
        raise IbdataError(f"{place}: {count}: {', '.join(lost[:MOST])}{more}; {todo}")
    return whole
