"""Card and report of a dataset, which somebody may have edited: a replacement loses no text of theirs."""

from __future__ import annotations

import os
import sys
from itertools import count
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.errors import UsageError, printable
from ibdata.generation.unsettled import files_in, listed_in
from ibdata.system.atomic_files import create_or_compare, file_sha256, sync_folder
from ibdata.writing.card import has_other_text


def refuse_edits(folder: Path, listed: Manifest, by: str) -> None:
    """Raise UsageError if somebody has edited the card or the report, which would be replaced or removed."""
    entries = listed.entries()
    for path in (manifest.CARD, manifest.REPORT):
        found = None if (folder / path).is_symlink() else file_sha256(folder / path)
        if path in entries and found not in (None, entries[path].sha256):
            raise UsageError(f"{folder / path}: was edited, and {by} would replace it; move it away first")


def place_single_files(new: Path, folder: Path) -> None:
    """Move card and report to their places if the manifest lists them; remove the old report if not."""
    listed = listed_in(folder).entries()
    lists = (files_in(new), files_in(new, "old-meta/manifest.json"))
    old = {file.path: file.sha256 for files in lists for file in files}
    for path in (manifest.CARD, manifest.REPORT):
        if path not in listed and path in old:
            _keep_edited(folder, path, old[path])
            (folder / path).unlink(missing_ok=True)  # of the dataset that was replaced
        elif path in listed and file_sha256(new / path) == listed[path].sha256:
            _keep_edited(folder, path, old.get(path), (new / path).read_bytes())
            (new / path).replace(folder / path)
    sync_folder(folder)


def _keep_edited(folder: Path, name: str, sha256: str | None, made: bytes = b"") -> None:
    """Keep a card or report under another name unless it is the old one, which has this SHA-256.

    A card that is only damaged, when compared with the one that was `made`, is not kept; one that cannot be
    read is. A line on stderr says where an edited one is.
    """
    path = folder / name
    found_sha256 = file_sha256(path)
    if path.is_symlink() or not path.is_file() or found_sha256 == sha256:
        return
    found = None if found_sha256 is None else path.read_bytes()
    if found is None or name != manifest.CARD or has_other_text(found, made):
        stem, end = path.stem, path.suffix
        names = (f"{stem}-edited{end}" if i == 1 else f"{stem}-edited-{i}{end}" for i in count(1))
        if found is None:
            name = next(name for name in names if not os.path.lexists(folder / name))
            path.rename(folder / name)
        else:
            name = next(name for name in names if create_or_compare(folder, name, found))
        told = f"ibdata: {path}: found a text that ibdata did not write; it is now in {name}"
        print(printable(told), file=sys.stderr, flush=True)
