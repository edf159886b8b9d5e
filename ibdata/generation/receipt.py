"""Receipts of the shards that an unfinished run has written, from which it is resumed.

They name the content of each shard, which is read and compared when the run goes on.
"""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any

from ibdata.dataset import manifest
from ibdata.errors import IbdataError
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.system.atomic_files import TOKEN, FileEntry, file_sha256, plain_bytes, write
from ibdata.writing.shard_writer import WrittenShard, file_of
from ibdata.writing.stored import stored_content
from ibdata.writing.summary import content_of

FOLDER = manifest.RUN
MAX_BYTES = 2**16


def path_of(shard: Shard) -> str:
    """The path of a shard's receipt within the folder of the dataset."""
    return f"{FOLDER}/part-{shard.number:05d}.receipt"


def put(folder: Path, identity: str, written: WrittenShard) -> None:
    """Write the receipt of a shard whose file is on the disk."""
    header = {
        "identity": identity,
        "shard": list(written.shard),
        "entry": list(written.entry),
        "content": content_of(written.content.digests),
        "clipped": written.content.clipped,
    }
    data = json.dumps(header).encode()
    write(folder, path_of(written.shard), hashlib.sha256(data).digest() + data)


def get(folder: Path, identity: str, spec: DatasetSpec, shard: Shard) -> WrittenShard | None:
    """Read a shard that has a receipt. None unless receipt and file are undamaged and belong to this run."""
    try:
        data = plain_bytes(folder / path_of(shard), MAX_BYTES)
        if hashlib.sha256(data[32:]).digest() != data[:32]:
            return None
        header: dict[str, Any] = json.loads(data[32:])
        entry = FileEntry(*header["entry"])
        same = header["identity"] == identity and header["shard"] == json.loads(json.dumps(shard))
        named = re.fullmatch(re.escape(file_of(shard)).replace(re.escape(TOKEN), "[0-9a-f]{8}"), entry.path)
        if not (same and named and file_sha256(folder / entry.path) == entry.sha256):
            return None
        content = stored_content(spec, shard, folder, entry.path)._replace(clipped=header["clipped"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError, IbdataError):
        return None
    whole = content_of(content.digests) == header["content"]
    return WrittenShard(shard, entry, content) if whole else None
