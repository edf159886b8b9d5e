"""Replacing a dataset, or parts of it, so that every reader meets the old one or the new one, and no mixture.

What is new is written to `.next`, whole folders of it. Renaming that to `.new` makes it count. Then `data`,
and after it `meta`, change places with those in `.new`, each in one system call, and what was replaced is
removed. Shards have names of their own, so whoever listed the old folder finds no new file under an old name.
pyarrow drops listed names that are gone when it looks at them, and would read nothing: so for a moment the
new folder holds a file of text under an old name, on which readers fail; the old folder keeps one for good.
A new folder holds an empty file, `FRESH`, until all is in place: it tells how far a killed writer came.
`.next` and `.new` hold another, `MARK`, without which they are somebody else's, and nothing is touched.
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
PAUSE = 0.25  # seconds in which readers that have listed the old folder look at the files by name


@contextmanager
def staged(folder: Path) -> Iterator[Path]:
    """An empty `.next`; what the block puts there replaces what the dataset has, or nothing changes."""
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
    """Let what is in `.next` replace what the dataset has: `data` and `meta` as a whole, card and report."""
    root = folder / NEXT
    if not (root / manifest.PATH).is_file():  # nothing is to be replaced
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
    """DatasetError where a folder is in the place of one of these files."""
    for path in paths:
        if (folder / path).is_dir():
            raise DatasetError(f"{folder / path}: found a folder in the place of a file; move it away")


def _take_back(folder: Path) -> bool:
    """Put the old `data` back and let `.new` count for nothing; whether that was done: not if `meta` is new.

    Nor where the dataset had no `data`: then there is nothing to put back.
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
    """Have files of the dataset in `.next` as they are."""
    for path in paths:
        (root / path).parent.mkdir(exist_ok=True)
        try:
            os.link(folder / path, root / path)
        except OSError:  # a file system without links
            write(root, path, (folder / path).read_bytes())


def finish_interrupted(folder: Path) -> None:
    """Finish what a writer began to replace that was killed; remove a `.new` that does not count."""
    new = folder / NEW
    if not os.path.lexists(new):
        return
    for root in (new, folder / NEXT):
        staging.refuse_foreign(root)
    with held():
        if _counts(folder):
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
    """Let `.new` be `.next` again, which counts for nothing, and remove it."""
    discard(folder / NEXT)
    (folder / NEW).rename(folder / NEXT)
    sync_folder(folder)
    for data in (folder / NEXT / "data", folder / NEXT / "old-data"):
        if data.is_dir() and (folder / manifest.PATH).is_file():
            with suppress(OSError):
                _put_bar(data / REPLACED)
    discard(folder / NEXT, keep=REPLACED)


def _bar(folder: Path, root: Path) -> None:
    """Have a file in the new folder on which a reader fails that has listed the old one."""
    for path in _paths(folder)[:1]:
        if is_ours(folder / path) and path.startswith("data/"):
            _put_bar(root / path)


def _put_bar(path: Path) -> None:
    with path.open("xb") as file:  # which follows no link
        file.write(BAR)


def _unbar(folder: Path) -> None:
    """Take away what `_bar` made."""
    listed = _paths(folder)
    found = [path for path in (folder / "data").glob("part-*") if f"data/{path.name}" not in listed]
    barred = [path for path in found if is_ours(path) and path.lstat().st_size == len(BAR)]
    if barred:
        time.sleep(PAUSE)
    for path in barred:
        path.unlink()


def begun(folder: Path) -> list[str]:
    """What a killed writer left of a new dataset that has no place yet: the names in the folder."""
    if os.path.lexists(folder / manifest.PATH):
        return []
    return [NEW, *(["data"] if (folder / "data" / FRESH).is_file() else [])]


def withdraw(folder: Path) -> None:
    """Remove what `begun` names."""
    new = folder / NEW
    if not os.path.lexists(new):
        return
    (new / "meta" / FRESH).unlink(missing_ok=True)  # from here on it counts for nothing
    if (folder / "data" / FRESH).is_file():
        (folder / "data").rename(new / "data")
    _dismiss(folder)


def _paths(folder: Path, path: str = manifest.PATH) -> list[str]:
    """The paths of the files that the manifest in a folder lists; none where there is no whole manifest."""
    try:
        return [file.path for file in _manifest(folder, path).files]
    except (OSError, DatasetError):
        return []


def _manifest(folder: Path, path: str = manifest.PATH) -> Manifest:
    return manifest.parsed(folder / path, plain_bytes(folder / path, manifest.MAX_BYTES))


def _counts(folder: Path) -> bool:
    """Whether `.new` is a replacement that was made to count: all that its manifest lists is there."""
    new = folder / NEW
    if not (new / "meta" / FRESH).is_file():
        return (folder / "meta" / FRESH).is_file()  # then `meta` has its place already
    paths = _paths(new)
    return bool(paths) and all((new / path).is_file() or (folder / path).is_file() for path in paths)


def _is_half(folder: Path) -> bool:
    """Whether `data` has changed places and the rest is lost, as in a copy of a part of the folder."""
    shards = [path for path in _paths(folder) if path.startswith("data/")]
    here = (folder / "data" / FRESH).is_file() and bool(shards)
    return here and all((folder / NEW / path).is_file() for path in shards)


def _swap(new: Path, folder: Path, part: str) -> None:
    """Let a new folder take its place; the old one is in `.new` afterwards."""
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
    """Card and report go to their places, if they are what the manifest lists; a report of old goes."""
    listed = _manifest(folder).entries()
    for path in (manifest.CARD, manifest.REPORT):
        if path not in listed and path in [*_paths(new), *_paths(new, "old-meta/manifest.json")]:
            (folder / path).unlink(missing_ok=True)  # of the dataset that was replaced
        elif path in listed and file_sha256(new / path) == listed[path].sha256:
            (new / path).replace(folder / path)
    sync_folder(folder)


def _give_back(new: Path, folder: Path) -> None:
    """What a user has put into a folder that was replaced moves on to the new one."""
    for part in PARTS:
        for old in (new / part, new / f"old-{part}"):
            for path in sorted(old.iterdir()) if old.is_dir() and not old.is_symlink() else ():
                read = part == "data" and is_stranger(path)
                if not (is_ours(path) or is_busy(path) or read or os.path.lexists(folder / part / path.name)):
                    path.rename(folder / part / path.name)
