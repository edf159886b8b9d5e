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
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.manifest import BAR, FRESH, NEW, NEXT, REPLACED
from ibdata.dataset.strangers import is_stranger
from ibdata.errors import DatasetError, printable
from ibdata.generation import staging, unsettled
from ibdata.generation.single_files import place_single_files
from ibdata.generation.staging import discard, is_busy, is_ours
from ibdata.generation.unsettled import PARTS, is_complete, old_data, paths_in
from ibdata.system.atomic_files import sync_folder, write
from ibdata.system.exchange import exchanged, naming, refuse_immovable
from ibdata.system.lock import is_lost
from ibdata.system.signals import held

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
    if (folder / manifest.SPLITS).is_file() and not (root / manifest.SPLITS).is_file():
        keep(folder, root, [manifest.SPLITS])
    try:
        refuse_folders(folder, [manifest.PATH, *paths_in(folder), *paths_in(root)])
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
            _settle(folder)
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
    new = folder / NEW
    if not (new / "meta" / FRESH).is_file():
        return False
    old = old_data(folder)
    if old is not None:
        _put_back(folder, old)
    elif (folder / "data" / FRESH).is_file():
        return False
    new.rename(folder / NEXT)
    sync_folder(folder)
    return True


def _put_back(folder: Path, old: Path) -> None:
    """Move the old data, which are in a folder of `.new`, to their place."""
    new, data = folder / NEW, folder / "data"
    if data.is_dir():
        for path in paths_in(new)[:1]:  # as in `_bar`, for readers that have listed the new folder
            _put_bar(old / Path(path).name)
    if old == new / "data":
        _swap(new, folder, "data")
    else:
        if data.is_dir():
            data.rename(new / "data")
        old.rename(data)
    sync_folder(new)
    sync_folder(folder)
    _unbar(folder)


def keep(folder: Path, root: Path, paths: Iterable[str]) -> None:
    """Put unchanged files of the dataset into `.next`."""
    for path in paths:
        (root / path).parent.mkdir(exist_ok=True)
        try:
            os.link(folder / path, root / path)
        except OSError:  # a file system without links
            write(root, path, (folder / path).read_bytes())


def finish_interrupted(folder: Path) -> None:
    """Finish the replacement of a killed writer; remove a `.new` that is not a complete replacement.

    While the old dataset is still there, the new files are compared with their manifest before they replace
    any. If one is damaged, the replacement is withdrawn, and a line on stderr says so.

    Raises DatasetError if the old dataset is damaged too; nothing is changed then.
    """
    if not os.path.lexists(folder / NEW):
        return
    for root in (folder / NEW, folder / NEXT):
        staging.refuse_foreign(root)
    damaged = unsettled.damaged(folder)
    if damaged is None:
        with held():
            _settle(folder)
        return
    found = "found other content than the manifest of an interrupted replacement lists"
    if lost := unsettled.lost(folder):
        raise DatasetError(
            f"{damaged}: {found}, and {lost} of the old dataset is missing or damaged too; restore one "
            f"of the two, or move {folder / NEW} away; nothing was changed"
        )
    with held():
        discard(folder / NEXT)
        _take_back(folder)
        discard(folder / NEXT)
    told = f"ibdata: {damaged}: {found}; the replacement was withdrawn, and the old dataset stays"
    print(printable(told), file=sys.stderr, flush=True)


def _settle(folder: Path) -> None:
    """Finish the replacement in `.new`, or remove it if it is not complete."""
    new = folder / NEW
    if is_complete(folder):
        for part in PARTS:
            if (new / part / FRESH).is_file():
                _swap(new, folder, part)
        place_single_files(new, folder)
        _give_back(new, folder)
        _unbar(folder)
        for part in PARTS:
            (folder / part / FRESH).unlink(missing_ok=True)
    elif (old := old_data(folder)) is not None:  # the new `meta` is lost, as in a copy of a part
        _put_back(folder, old)
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
    for path in paths_in(folder)[:1]:
        if is_ours(folder / path) and path.startswith("data/"):
            _put_bar(root / path)


def _put_bar(path: Path) -> None:
    with path.open("xb") as file:  # "x" follows no link
        file.write(BAR)


def _unbar(folder: Path) -> None:
    """Remove the file that `_bar` made."""
    listed = paths_in(folder)
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


def _give_back(new: Path, folder: Path) -> None:
    """Move files that a user has put into an old folder to the new one.

    A file that readers of the new data would take goes beside them; a line on stderr says where it is.
    """
    for part in PARTS:
        for old in (new / part, new / f"old-{part}"):
            for path in sorted(old.iterdir()) if old.is_dir() and not old.is_symlink() else ():
                if is_ours(path) or is_busy(path):
                    continue
                read = part == "data" and is_stranger(path.name + "/" * path.is_dir())
                if not read and not os.path.lexists(folder / part / path.name):
                    path.rename(folder / part / path.name)
                    continue
                names = (f"moved-{path.name}" if i == 1 else f"moved-{i}-{path.name}" for i in count(1))
                name = next(name for name in names if not os.path.lexists(folder / name))
                path.rename(folder / name)
                told = f"{folder / part / path.name}: is not of the dataset; it is now {folder / name}"
                print(printable(f"ibdata: {told}"), file=sys.stderr, flush=True)
