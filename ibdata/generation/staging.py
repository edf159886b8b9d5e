"""The folders `.next` and `.new`, in which a dataset is replaced: ibdata knows them by a mark of its own.

Only what has the mark, or holds nothing, is finished or removed; anything else under these names is refused
before anything is changed.
"""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.errors import UsageError
from ibdata.generation import receipt
from ibdata.system.atomic_files import remove_temporaries, sync_folder
from ibdata.writing.card import is_foreign

EXPERIMENT = f"{receipt.FOLDER}/experiment.yaml"
WEIGHTS = manifest.WEIGHTS.pattern.removeprefix("meta/")
OURS = re.compile(rf"part-[0-9]{{5,}}-[0-9a-f]{{8}}\.parquet|experiment-[0-9]{{5,}}\.yaml|{WEIGHTS}")
METADATA = {
    manifest.FRESH,
    manifest.REPLACED,
    *(Path(path).name for path in (*manifest.METADATA, manifest.PATH)),
}
BUSY = re.compile(r"\.(nfs|fuse_hidden).*")  # a file that was removed, and that somebody has open still
STAGED_FOLDERS = re.compile(r"data|meta|old-(data|meta|[0-9a-f]{8})|" + re.escape(receipt.FOLDER))
STAGED_FILES = re.compile(
    "|".join(map(re.escape, (manifest.CARD, manifest.REPORT, manifest.MARK)))
    + rf"|\.tmp-[0-9a-f]{{12}}-.*\.part|{BUSY.pattern}"
)


def refuse_foreign(root: Path, inside: bool = False) -> None:
    """UsageError for a `.next` or `.new` that ibdata did not make, or that holds something else beside.

    Args:
        root: The folder, which need not exist.
        inside: Whether to look into its folders too. Those that were replaced may hold files of a user.
    """
    for path in _foreign(root, inside):
        raise UsageError(f"{path}: found something that ibdata did not write; move it away")


def _foreign(root: Path, inside: bool) -> Iterator[Path]:
    if os.path.lexists(root) and not _is_staging(root):
        yield root
    elif root.is_dir():
        for path in sorted(root.iterdir()):
            folder = path.is_dir() and not path.is_symlink()
            if not (STAGED_FOLDERS if folder else STAGED_FILES).fullmatch(path.name):
                yield path
            elif inside and folder and path.name != receipt.FOLDER:
                yield from (own for own in sorted(path.iterdir()) if not (is_ours(own) or is_busy(own)))


def _is_staging(root: Path) -> bool:
    """Whether a `.next` or `.new` has ibdata's mark, or holds no file but what a replacement leaves."""
    if not root.is_dir():
        return False
    files = [Path(folder, name) for folder, _, names in os.walk(root) for name in names]
    return (root / manifest.MARK).is_file() or all(is_busy(path) or _is_bar(path) for path in files)


def _is_bar(path: Path) -> bool:
    """Whether a file keeps a folder that was replaced from being read as empty; it may be damaged."""
    with suppress(OSError):
        return path.name == manifest.REPLACED and path.lstat().st_size <= len(manifest.BAR)
    return False


def is_busy(path: Path) -> bool:
    """Whether a file was removed already, on a file system that keeps it for whoever has it open."""
    return BUSY.fullmatch(path.name) is not None


def make(root: Path) -> None:
    """Make `.next` with its mark, by which alone ibdata knows it again."""
    root.mkdir(exist_ok=True)
    (root / manifest.MARK).touch()
    sync_folder(root)


def discard(root: Path, keep: str = "") -> None:
    """Remove an unfinished run, or the files of a dataset that `.next` holds except `keep`; nothing else.

    Files that somebody has open may stay in `.next`, in a folder `old-…`, until the next time.

    Raises UsageError where `.next` holds something that ibdata did not write; then nothing is removed.
    """
    if not root.is_dir() or root.is_symlink():
        return
    staged = root.name == manifest.NEXT
    if staged:
        refuse_foreign(root, inside=True)
    remove_temporaries(root)
    for folder in (root / "data", root / "meta", *(root.glob("old-*") if staged else ())):
        if folder.is_dir() and not folder.is_symlink():
            for path in folder.iterdir():
                if is_ours(path) and path.name != keep and (staged or path.name != Path(manifest.PATH).name):
                    path.unlink()
            if not any(folder.iterdir()):
                folder.rmdir()
            elif staged and all(is_busy(path) for path in folder.iterdir()):
                folder.rename(root / f"old-{secrets.token_hex(4)}")
    if staged or not is_foreign(root / manifest.CARD):
        (root / manifest.CARD).unlink(missing_ok=True)
    if staged:  # no unfinished run has a report
        (root / manifest.REPORT).unlink(missing_ok=True)
    empty_run(root / receipt.FOLDER)
    if staged:
        (root / manifest.MARK).unlink(missing_ok=True)  # last, so that who goes on knows the rest
        if not any(root.iterdir()):
            root.rmdir()


def is_ours(path: Path) -> bool:
    """Whether a file in `data` or `meta` has a name that ibdata gives."""
    return not path.is_dir() and (path.name in METADATA or OURS.fullmatch(path.name) is not None)


def empty_run(folder: Path) -> None:
    """Remove the receipts and notes of a run."""
    if folder.is_dir() and not folder.is_symlink():
        said = folder / Path(EXPERIMENT).name  # last: it says whose run this is while anything is left of it
        for inner in (*(inner for inner in folder.iterdir() if inner != said), said):
            inner.unlink(missing_ok=True)
        folder.rmdir()
