"""Replacing a dataset, or parts of it. Every reader finds the old one or the new one, never a mixture.

The new folders are written to `.next`. Renaming `.next` to `.new` commits them: from then on, a replacement
that is interrupted is finished, not undone. Then `data`, and after it `meta`, change places with those in
`.new`, each in one system call, and the old folders are removed.

Every shard has a name that no other shard had, so a reader that has listed the old folder finds no new file
under an old name. But pyarrow skips listed files that are gone, and would then read an empty dataset. So for
a moment the new folder holds `BAR` under an old name, a text on which such readers fail, and the old folder
keeps such a file for good. Each new folder holds an empty file, `FRESH`, until all is in place, which shows
how far a killed writer came. `.next` and `.new` hold the empty file `MARK`; without it, they belong to
somebody else, and nothing is touched.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.manifest import BAR, FRESH, NEW, NEXT, REPLACED
from ibdata.dataset.models import Manifest
from ibdata.errors import DatasetError
from ibdata.generation import staging
from ibdata.generation.staging import discard, is_busy, is_ours
from ibdata.system.atomic_files import file_sha256, plain_bytes, sync_folder, write
from ibdata.system.exchange import exchanged, naming, refuse_immovable
from ibdata.system.lock import is_lost
from ibdata.system.signals import held
from ibdata.validation.validate import is_stranger

PARTS = ("data", "meta")
PAUSE = 0.25  # seconds for readers that have listed the old folder to look at its files


@contextmanager
def staged(folder: Path) -> Iterator[Path]:
    """Yield an empty `.next`, and commit the files in it at the end of the block, unless the block raises."""
    root = folder / NEXT
    discard(root)
    try:
        staging.make(root)
        yield root
    except BaseException:
        if not is_lost(folder):
            discard(root)
        raise
    commit(folder)


def commit(folder: Path) -> None:
    """Replace the parts of the dataset that `.next` holds: whole folders `data` and `meta`, card, report."""
    root = folder / NEXT
    if not (root / manifest.PATH).is_file():  # there is nothing to replace
        discard(root)
        return
    try:
        refuse_folders(folder, [manifest.PATH, *_paths(folder), *_paths(root)])
        for part in PARTS:
            if (folder / part).is_dir() and (root / part).is_dir():
                refuse_immovable(folder / part, root / part)
    except (DatasetError, OSError):
        discard(root)
        raise
    if (root / "data").is_dir():
        _bar(folder, root)
    for part in PARTS:
        (folder / part / FRESH).unlink(missing_ok=True)  # of a copy of a folder that was unsettled
        if (root / part).is_dir():
            (root / part / FRESH).touch()
            sync_folder(root / part)
    sync_folder(root)
    with held():
        root.rename(folder / NEW)
        sync_folder(folder)
        try:
            finish_interrupted(folder)
        except OSError:
            if _take_back(folder):
                discard(root)
            raise


def refuse_folders(folder: Path, paths: Iterable[str]) -> None:
    """Raise DatasetError if a folder is in the place of one of these files."""
    for path in paths:
        if (folder / path).is_dir():
            raise DatasetError(f"{folder / path}: found a folder in the place of a file; move it away")


def _take_back(folder: Path) -> bool:
    """Put the old `data` back and rename `.new` to `.next`. Return whether that was done.

    It is not done if `meta` is in place already, or if the dataset had no `data` to put back.
    """
    new, data = folder / NEW, folder / "data"
    if not (new / "meta" / FRESH).is_file():
        return False
    moved = (data / FRESH).is_file()
    parts = [part for part in (new / "old-data", new / "data") if part.is_dir()]
    old = next((part for part in parts if not (part / FRESH).is_file()), None)
    if old is not None:
        if moved:  # as in `_bar`, for readers that have listed the new folder
            _put_bar(old / Path(_paths(new)[0]).name)
        if old == new / "data":
            exchanged(old, data)
        else:
            if moved:
                data.rename(new / "data")
            old.rename(data)
        sync_folder(new)
        sync_folder(folder)
        _unbar(folder)
    elif moved:
        return False
    new.rename(folder / NEXT)
    sync_folder(folder)
    return True


def keep(folder: Path, root: Path, paths: Iterable[str]) -> None:
    """Put unchanged files of the dataset into `.next`."""
    for path in paths:
        (root / path).parent.mkdir(exist_ok=True)
        try:
            os.link(folder / path, root / path)
        except OSError:  # a file system without links
            write(root, path, (folder / path).read_bytes())


def finish_interrupted(folder: Path) -> None:
    """Finish the replacement of a killed writer; remove a `.new` that is not a complete replacement."""
    new = folder / NEW
    if not os.path.lexists(new):
        return
    for root in (new, folder / NEXT):
        staging.refuse_foreign(root)
    with held():
        if _is_complete(folder):
            for part in PARTS:
                if (new / part / FRESH).is_file():
                    _swap(new, folder, part)
            _place_single_files(new, folder)
            _give_back(new, folder)
            _unbar(folder)
            for part in PARTS:
                (folder / part / FRESH).unlink(missing_ok=True)
        elif _is_half(folder):
            (folder / "data" / FRESH).unlink()
            _swap(new, folder, "data")
        _dismiss(folder)


def _dismiss(folder: Path) -> None:
    """Rename `.new` to `.next`, which readers ignore, and remove it."""
    discard(folder / NEXT)
    (folder / NEW).rename(folder / NEXT)
    sync_folder(folder)
    for data in (folder / NEXT / "data", folder / NEXT / "old-data"):
        if data.is_dir() and (folder / manifest.PATH).is_file():
            with suppress(OSError):
                _put_bar(data / REPLACED)
    discard(folder / NEXT, keep=REPLACED)


def _bar(folder: Path, root: Path) -> None:
    """Put `BAR` into the new folder under an old name, so that readers that have listed the old one fail."""
    for path in _paths(folder)[:1]:
        if is_ours(folder / path) and path.startswith("data/"):
            _put_bar(root / path)


def _put_bar(path: Path) -> None:
    with path.open("xb") as file:  # "x" follows no link
        file.write(BAR)


def _unbar(folder: Path) -> None:
    """Remove the file that `_bar` made."""
    listed = _paths(folder)
    found = [path for path in (folder / "data").glob("part-*") if f"data/{path.name}" not in listed]
    barred = [path for path in found if is_ours(path) and path.lstat().st_size == len(BAR)]
    if barred:
        time.sleep(PAUSE)
    for path in barred:
        path.unlink()


def begun(folder: Path) -> list[str]:
    """The names of the files and folders that a killed writer left where no dataset was before."""
    if os.path.lexists(folder / manifest.PATH):
        return []
    return [NEW, *(["data"] if (folder / "data" / FRESH).is_file() else [])]


def withdraw(folder: Path) -> None:
    """Remove the files and folders that `begun` names."""
    new = folder / NEW
    if not os.path.lexists(new):
        return
    (new / "meta" / FRESH).unlink(missing_ok=True)  # from here on it is not a complete replacement
    if (folder / "data" / FRESH).is_file():
        (folder / "data").rename(new / "data")
    _dismiss(folder)


def _paths(folder: Path, path: str = manifest.PATH) -> list[str]:
    """The paths of the files that the manifest in a folder lists; none without a valid manifest."""
    try:
        return [file.path for file in _manifest(folder, path).files]
    except (OSError, DatasetError):
        return []


def _manifest(folder: Path, path: str = manifest.PATH) -> Manifest:
    return manifest.parsed(folder / path, plain_bytes(folder / path, manifest.MAX_BYTES))


def _is_complete(folder: Path) -> bool:
    """Whether `.new` is a complete replacement: all files that its manifest lists are there."""
    new = folder / NEW
    if not (new / "meta" / FRESH).is_file():
        return (folder / "meta" / FRESH).is_file()  # `meta` may be in its place already
    paths = _paths(new)
    return bool(paths) and all((new / path).is_file() or (folder / path).is_file() for path in paths)


def _is_half(folder: Path) -> bool:
    """Whether `data` is in its place but the new `meta` is lost, as in a copy of a part of the folder."""
    shards = [path for path in _paths(folder) if path.startswith("data/")]
    here = (folder / "data" / FRESH).is_file() and bool(shards)
    return here and all((folder / NEW / path).is_file() for path in shards)


def _swap(new: Path, folder: Path, part: str) -> None:
    """Move a new folder to its place, and the old one to `.new`."""
    source, target = new / part, folder / part
    try:
        if os.path.lexists(target) and not exchanged(source, target):
            target.rename(new / f"old-{part}")  # readers from outside find no folder for a moment
        if not os.path.lexists(target):
            source.rename(target)
    except OSError as error:
        raise naming(target, error) from error
    sync_folder(new)
    sync_folder(folder)


def _place_single_files(new: Path, folder: Path) -> None:
    """Move card and report to their places if the manifest lists them; remove the old report if not."""
    listed = _manifest(folder).entries()
    for path in (manifest.CARD, manifest.REPORT):
        if path not in listed and path in [*_paths(new), *_paths(new, "old-meta/manifest.json")]:
            (folder / path).unlink(missing_ok=True)  # of the dataset that was replaced
        elif path in listed and file_sha256(new / path) == listed[path].sha256:
            (new / path).replace(folder / path)
    sync_folder(folder)


def _give_back(new: Path, folder: Path) -> None:
    """Move files that a user has put into an old folder to the new one."""
    for part in PARTS:
        for old in (new / part, new / f"old-{part}"):
            for path in sorted(old.iterdir()) if old.is_dir() and not old.is_symlink() else ():
                read = part == "data" and is_stranger(path)
                if not (is_ours(path) or is_busy(path) or read or os.path.lexists(folder / part / path.name)):
                    path.rename(folder / part / path.name)
