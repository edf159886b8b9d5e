"""Whether a file is an export of ibdata, by what each format says of itself in it."""

from __future__ import annotations

import gzip
import json
import zipfile
from pathlib import Path

from ibdata.system.files import plain_bytes

HEAD = 8  # bytes
CSV = b'"episode","step"'


def is_folder_export(folder: Path) -> bool:
    """Whether a folder with data/ is a dataset of Minari or LeRobot that `export` has written."""
    tasks = folder / "meta" / "tasks.parquet"  # of LeRobot
    try:
        if tasks.exists():
            return is_export(tasks)
        return "content_root" in json.loads(plain_bytes(folder / "data" / "metadata.json"))["view"]
    except (OSError, ValueError, KeyError, TypeError):
        return False


def is_export(path: Path) -> bool:
    """Whether a file is one that `export` has written, or holds nothing."""
    with path.open("rb") as file:
        head = file.read(HEAD)
    try:
        if head.startswith(b"PK"):
            with zipfile.ZipFile(path) as archive:
                return b'"content_root"' in archive.comment
        if head.startswith(b"\x89HDF"):
            import h5py

            with h5py.File(path) as hdf5:
                return "content_root" in str(hdf5.attrs["view"])
        if head.startswith(b"PAR1"):
            import pyarrow.parquet as pq

            return b"content_root" in pq.read_schema(path).metadata[b"view"]
        opened = gzip.open if head.startswith(b"\x1f\x8b") else Path.open
        with opened(path, "rb") as text:
            return not head or text.read(len(CSV)) == CSV
    except Exception:  # whatever the libraries raise for other bytes
        return False
