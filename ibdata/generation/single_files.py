"""Card and report of a dataset, which somebody may have edited: a replacement loses no text of theirs."""

from __future__ import annotations

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
            (folder / path).unlink(missing_ok=True)  # of the dataset that was replaced
        elif path in listed and file_sha256(new / path) == listed[path].sha256:
            if path == manifest.CARD:
                _keep_edited(folder, old.get(path), (new / path).read_bytes())
            (new / path).replace(folder / path)
    sync_folder(folder)


def _keep_edited(folder: Path, sha256: str | None, made: bytes) -> None:
    """Keep the text of a card under another name unless it is the old one, which has this SHA-256.

    A card that is only damaged is not kept. A line on stderr says where an edited one is.
    """
    path = folder / manifest.CARD
    if path.is_symlink() or file_sha256(path) in (None, sha256):
        return
    found = path.read_bytes()
    if has_other_text(found, made):
        names = ("README-edited.md" if i == 1 else f"README-edited-{i}.md" for i in count(1))
        name = next(name for name in names if create_or_compare(folder, name, found))
        told = f"ibdata: {path}: found a text that ibdata did not write; it is now in {name}"
        print(printable(told), file=sys.stderr, flush=True)
