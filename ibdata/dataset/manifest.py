"""meta/manifest.json, written last: what is listed there exists, and nothing else does."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ibdata.errors import DatasetError

PATH = "meta/manifest.json"
FORMAT = "ibdata-manifest"
VERSION = 1
DATA_VERSION = 1  # raised whenever the same experiment gives other bytes
SAFE_PATH = re.compile(r"(README\.md|(data|meta)/[a-z0-9][a-z0-9._-]{0,100})")


def read(folder: Path) -> dict[str, Any]:
    """The manifest of a finished dataset; DatasetError where there is none, or not a whole one."""
    path = folder / PATH
    try:
        data = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise DatasetError(f"{folder}: no finished dataset here: {PATH} is missing") from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise DatasetError(f"{path}: found no valid JSON ({error}), expected a manifest") from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise DatasetError(f"{path}: found another format, expected {FORMAT}")
    if data.get("version") != VERSION:
        raise DatasetError(
            f"{path}: found version {data.get('version')}, expected {VERSION}; use a newer ibdata"
        )
    if data.get("checksum") != checksum(data):
        raise DatasetError(f"{path}: found content that does not fit its checksum; the file has been changed")
    unsafe = [file["path"] for file in data["files"] if not SAFE_PATH.fullmatch(file["path"])]
    if unsafe:
        raise DatasetError(f"{path}: found the path {unsafe[0]!r}, expected paths in data/ and meta/")
    return data


def checksum(content: Mapping[str, Any]) -> str:
    """SHA-256 of the manifest without its checksum, as JSON with sorted keys."""
    rest = {key: value for key, value in content.items() if key != "checksum"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()
