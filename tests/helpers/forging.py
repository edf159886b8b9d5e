"""Making all hashes of a changed dataset right again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ibdata.dataset import manifest
from ibdata.writing.metadata import as_json

Json = dict[str, Any]


def seal(folder: Path, change: Callable[[Json], object] = lambda listed: None) -> None:
    """Give the manifest the hashes of all files as they are, then change it, then give it its checksum."""
    listed = json.loads((folder / manifest.PATH).read_bytes())
    for file in listed["files"]:
        data = (folder / file["path"]).read_bytes()
        file |= {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
    change(listed)
    listed["checksum"] = manifest.checksum(listed)
    (folder / manifest.PATH).write_bytes(as_json(listed))
