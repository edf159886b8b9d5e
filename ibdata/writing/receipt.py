"""Receipts of the shards that an unfinished run has written, from which it is resumed.

They hold no statistics of splits that are labels: only `ibdata split` makes these, in finished datasets.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from ibdata.dataset import manifest
from ibdata.experiment.plan import Shard
from ibdata.system.atomic_files import TOKEN, FileEntry, file_sha256, plain_bytes, write
from ibdata.writing.shard_writer import WrittenShard, file_of
from ibdata.writing.statistics import Moments
from ibdata.writing.summary import ShardSummary

FOLDER = manifest.RUN
MAX_BYTES = 2**32
NO_RECEIPT = (OSError, ValueError, KeyError, TypeError, RecursionError, zipfile.BadZipFile, EOFError)


def path_of(shard: Shard) -> str:
    """The path of a shard's receipt within the folder of the dataset."""
    return f"{FOLDER}/part-{shard.number:05d}.receipt"


def put(folder: Path, identity: str, written: WrittenShard) -> None:
    """Write the receipt of a shard whose file is on the disk."""
    content = written.content
    header = {
        "identity": identity,
        "shard": list(written.shard),
        "entry": list(written.entry),
        "rows": content.moments.rows,
        "clipped": content.clipped,
    }
    body = io.BytesIO()
    np.savez(
        body,
        header=np.frombuffer(json.dumps(header).encode(), dtype=np.uint8),
        digests=np.frombuffer(b"".join(content.digests), dtype=np.uint8).reshape(-1, 32),
        returns=content.returns,
        moments=np.stack(content.moments[1:]),
        sample=content.sample,
    )
    data = body.getvalue()
    write(folder, path_of(written.shard), hashlib.sha256(data).digest() + data)


def get(folder: Path, identity: str, shard: Shard) -> WrittenShard | None:
    """Read the receipt of a shard. None unless receipt and file are undamaged and belong to this run."""
    try:
        data = plain_bytes(folder / path_of(shard), MAX_BYTES)
        if hashlib.sha256(data[32:]).digest() != data[:32]:
            return None
        written = _parsed(data[32:], identity, shard)
    except NO_RECEIPT:
        return None
    if written is None or file_sha256(folder / written.entry.path) != written.entry.sha256:
        return None
    return written


def _parsed(body: bytes, identity: str, shard: Shard) -> WrittenShard | None:
    """Parse a receipt; None if it belongs to another run or shard."""
    with np.load(io.BytesIO(body), allow_pickle=False) as arrays:
        header: dict[str, Any] = json.loads(arrays["header"].tobytes())
        entry = FileEntry(*header["entry"])
        content = ShardSummary(
            [bytes(digest) for digest in arrays["digests"]],
            arrays["returns"],
            Moments(header["rows"], *arrays["moments"]),
            arrays["sample"],
            header["clipped"],
            {},
        )
    same = header["identity"] == identity and header["shard"] == json.loads(json.dumps(shard))
    count = shard.stop - shard.first
    named = re.fullmatch(re.escape(file_of(shard)).replace(re.escape(TOKEN), "[0-9a-f]{8}"), entry.path)
    fits = len(content.digests) == len(content.returns) == count and named is not None
    return WrittenShard(shard, entry, content) if same and fits else None
