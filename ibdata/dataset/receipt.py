"""What is kept of each shard of a run that is not finished yet, so that it can be resumed.

Only experiments are run like that, and those have no later splits.
"""

from __future__ import annotations

import hashlib
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from ibdata.dataset.content import Content
from ibdata.dataset.files import FileEntry, file_sha256, write
from ibdata.dataset.shard import Written
from ibdata.dataset.statistics import Moments
from ibdata.experiment.plan import Shard

FOLDER = ".run"


def path_of(shard: Shard) -> str:
    """The receipt's path inside the dataset's folder."""
    return f"{FOLDER}/part-{shard.number:05d}.receipt"


def put(folder: Path, identity: str, written: Written) -> None:
    """Commit the receipt of a shard that is on the disk."""
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


def get(folder: Path, identity: str, shard: Shard) -> Written | None:
    """The shard as its receipt has it, if receipt and file are whole and of this experiment; else None."""
    try:
        data = (folder / path_of(shard)).read_bytes()
    except OSError:
        return None
    if hashlib.sha256(data[32:]).digest() != data[:32]:
        return None
    with np.load(io.BytesIO(data[32:]), allow_pickle=False) as arrays:
        header: dict[str, Any] = json.loads(arrays["header"].tobytes())
        entry = FileEntry(*header["entry"])
        if header["identity"] != identity or header["shard"] != json.loads(json.dumps(shard)):
            return None
        if file_sha256(folder / entry.path) != entry.sha256:
            return None
        content = Content(
            [bytes(digest) for digest in arrays["digests"]],
            arrays["returns"],
            Moments(header["rows"], *arrays["moments"]),
            arrays["sample"],
            header["clipped"],
            {},
        )
    return Written(shard, entry, content)
