"""README.md and report.html, which are the user's to edit: what was edited is never lost.

A file that ibdata writes ends in its own hash. One that does not was edited, and is kept as README.md.old,
README.md.old-2 … when ibdata writes another in its place.
"""

from __future__ import annotations

import hashlib
import os
import re
from itertools import count
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.errors import UsageError, notice
from ibdata.system.files import keep_access, plain_bytes, write_new

EDITABLE = (manifest.CARD, manifest.REPORT)
KEPT = re.compile(rf"({'|'.join(map(re.escape, EDITABLE))})\.old(-[0-9]+)?")
SEAL = b"\n<!-- SHA-256 of the text above: "


def is_users(name: str) -> bool:
    """Whether a name at the top of a dataset is that of a file which a user may have edited."""
    return name in EDITABLE or KEPT.fullmatch(name) is not None


def sealed(text: bytes) -> bytes:
    """A text with its hash in a comment at the end, by which it is known as ibdata's own."""
    return text + SEAL + hashlib.sha256(text).hexdigest().encode() + b" -->\n"


def keep_edited(name: str, old: Path, new: Path) -> None:
    """Keep a file of a folder in another, or in the same, under a free name if somebody has edited it."""
    file = old / name
    if not os.path.lexists(file):
        return
    try:
        text = plain_bytes(file)
    except OSError as error:
        raise UsageError(f"{file}: cannot be kept: {error.strerror}; move it away") from None
    if text == sealed(text.rpartition(SEAL)[0]):
        return
    names = (f"{name}.old" + (f"-{i}" if i > 1 else "") for i in count(1))
    kept = next(each for each in names if not os.path.lexists(old / each))
    write_new(new, kept, text)
    keep_access(file, new / kept)
    notice(f"{file}: was edited, and is now {kept}")


def keep_all(old: Path, new: Path) -> None:
    """Keep what somebody has edited in a folder that is replaced, and what was kept there before."""
    for file in old.iterdir():
        if KEPT.fullmatch(file.name):
            write_new(new, file.name, plain_bytes(file))
            keep_access(file, new / file.name)
    for name in EDITABLE:
        keep_edited(name, old, new)
