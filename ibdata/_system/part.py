"""The part of an output: the hidden folder `.NAME.part` beside its place, in which it is made.

A part belongs to the process that holds the lock in it. What was made in it appears at its place by one
rename. A run that makes a dataset has the folder `run` in it, with a note, receipts and the dataset. The part
stays after a process that failed only if its run has receipts, with which the next one can go on.
"""

from __future__ import annotations

import ctypes
import errno
import os
import re
import secrets
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from ibdata._system.files import part_of, paths_in, remove, rename, sync_folder
from ibdata._system.lock import Lock, locked
from ibdata._system.signals import ignore, stoppable
from ibdata.errors import OUT, WORKERS, IbdataError, UsageError, is_thread_limit, notice, reason

LOCK, RUN, OLD = "ibdata.lock", "run", "old"  # in a part
FOLDERS = re.compile(f"{RUN}|{OLD}|export|repair|windows|tmp-.*")
NOTE, RECEIPTS, DATASET = "run.json", "receipts", "dataset"  # in the folder of its run
# Seconds; hundreds of hosts may begin at once, and each holds the lock alone for milliseconds.
PATIENCE = 10.0
# Windows takes these names for those of devices, or leaves the end of a name away.
WINDOWS_NAMES = re.compile(
    r'(con|prn|aux|nul|(com|lpt)[0-9¹²³]) *(\..*)?|.*[ .]|.*[<>:"|?*\0-\x1f].*', re.I | re.S
)
AT_FDCWD, RENAME_EXCHANGE, RENAME_SWAP = -100, 2, 2  # of renameat2 and renamex_np


def exchanged(a: Path, b: Path) -> bool:
    """Let two folders change places in one system call; False where there is none that can.

    The call is Linux's renameat2, or macOS's renamex_np, which has not been tried on macOS.
    """
    if sys.platform == "win32":
        return False
    library, names = ctypes.CDLL(None, use_errno=True), (os.fsencode(a), os.fsencode(b))
    if hasattr(library, "renameat2"):
        failed = library.renameat2(AT_FDCWD, names[0], AT_FDCWD, names[1], RENAME_EXCHANGE)
    elif hasattr(library, "renamex_np"):
        failed = library.renamex_np(*names, RENAME_SWAP)
    else:
        return False
    if not failed:
        return True
    number = ctypes.get_errno()
    if number in (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP):
        return False
    raise OSError(number, os.strerror(number), str(b))


class Part:
    """The part of an output, as far as it exists.

    Attributes:
        target: The place of the output, without links.
        folder: The hidden folder beside it.
    """

    def __init__(self, target: Path) -> None:
        self.target = target
        self.folder = part_of(target)
        self.lock: Lock  # while this process holds the part

    @property
    def run(self) -> Path:
        """The folder of its run."""
        return self.folder / RUN

    @property
    def receipts(self) -> list[Path]:
        """The receipts of what is finished in it."""
        return existing_paths(self.run / RECEIPTS)

    def refuse_foreign(self) -> None:
        """Raise UsageError if there is something in the part that this ibdata did not make."""
        if foreign := self._foreign():
            raise UsageError(f"{foreign}: found what ibdata did not make, expected nothing; move it away")

    def _foreign(self) -> Path | None:
        """The part if its lock is missing, or what is no folder or file in it.

        Files elsewhere would be removed through a link. What is only removed may have links in it.
        """
        if os.path.islink(self.folder) or self.folder.is_file():
            return self.folder
        paths = existing_paths(self.folder)
        if paths and LOCK not in [path.name for path in paths]:  # which is removed after all else
            return self.folder
        for path in paths:
            if path.is_dir() and not FOLDERS.fullmatch(path.name):
                return path
        links = [path for path in (self.folder / OLD, self.run) if os.path.islink(path)]
        return links[0] if links else _irregular(self.run)

    def place(self, dataset: Path, replace: bool = False) -> None:
        """Give what was made in the part its name. Whatever had the name is in the part afterwards.

        A file or folder that is replaced changes places with the new one in one system call, if there is one.
        """
        ignore()  # what is published is finished, and not stopped
        is_folder = self.target.is_dir()
        is_taken = self.target.is_file() or (is_folder and any(self.target.iterdir()))
        is_littered = is_folder and not existing_paths(self.target)  # with what macOS leaves
        if not (is_taken and (replace or is_littered)):
            if sys.platform == "win32":  # where no folder takes the place of an empty one
                with suppress(OSError):
                    self.target.rmdir()
            rename(dataset, self.target)  # which fails where somebody has put files meanwhile
        elif not exchanged(dataset, self.target):
            remove(self.folder / OLD)
            rename(self.target, self.folder / OLD)  # readers find nothing for a moment
            rename(dataset, self.target)
            rename(self.folder / OLD, self.folder / f"tmp-{secrets.token_hex(8)}")
        sync_folder(self.target.parent)

    def restore(self) -> None:
        """Put back what a process that failed had moved away to replace it."""
        if os.path.lexists(self.folder / OLD):
            with suppress(OSError):
                self.target.rmdir()  # an empty folder
            if not os.path.lexists(self.target):
                rename(self.folder / OLD, self.target)

    def clear(self) -> None:
        """Remove all that is in it but the lock; its run at once, so that nobody goes on with its rest."""
        if os.path.lexists(self.run):
            rename(self.run, self.folder / f"tmp-{secrets.token_hex(8)}")
        for path in self.folder.iterdir():
            if path.name != LOCK:
                remove(path)

    def remove(self) -> None:
        """Remove what is in it, the lock last, so that nobody else begins before it is empty."""
        self.clear()
        self.lock.remove()


def existing_paths(folder: Path) -> list[Path]:
    """The files and folders in a folder, in order; none if there is no such folder."""
    try:
        return paths_in(folder)
    except (FileNotFoundError, NotADirectoryError):
        return []


def _irregular(folder: Path) -> Path | None:
    """The first path below a folder that is neither a folder nor a regular file; None if there is none."""
    with suppress(FileNotFoundError, NotADirectoryError), os.scandir(folder) as entries:
        for entry in entries:
            path = Path(entry)
            is_folder = entry.is_dir(follow_symlinks=False)
            found = _irregular(path) if is_folder else None
            if found or not (is_folder or entry.is_file(follow_symlinks=False)):
                return found or path
    return None


def resolved(out: str | os.PathLike[str]) -> Path:
    """The place of an output without links, which may lead to another disk."""
    if "\0" in os.fspath(out):
        raise UsageError(f"{OUT}: found {os.fspath(out)!r}, expected a path without NUL")
    path = Path(os.path.expanduser(out))
    for name in path.parts[bool(path.anchor) :] if sys.platform == "win32" else ():
        if name != ".." and WINDOWS_NAMES.fullmatch(name):
            raise UsageError(
                f"{out}: found {name!r}, which is no name of a folder in Windows; choose another"
            )
    return Path(os.path.realpath(path))


@contextmanager
def locked_part(
    target: Path,
    place: str | os.PathLike[str] | None = None,
    *,
    shared: bool = False,
    patience: float = 0.0,
) -> Iterator[Part]:
    """Hold the part of an output; its folder and the folders around it are made.

    Args:
        target: The place of the output, without links.
        place: Its name in messages; by default its path.
        shared: Whether other hosts may hold the part too.
        patience: How many seconds to wait while another process holds the part.

    Raises:
        BusyError: Another process holds the part.
        Interrupted: A signal asked to stop.
        IbdataError: The system refuses to write, or there is not enough memory.
    """
    name, part = os.fspath(place or target), Part(target)
    with refusing_system_errors(name), stoppable(), _made_parents(target), ExitStack() as stack:
        part.refuse_foreign()
        wait = PATIENCE if shared else patience
        part.lock = stack.enter_context(locked(part.folder / LOCK, wait, shared=shared, place=name))
        try:
            if not shared:
                part.restore()
            yield part
        finally:
            if part.lock.take_alone():
                part.restore()
                if not part.receipts:
                    try:
                        part.remove()
                    except OSError as error:  # Windows removes no open file
                        notice(
                            f"{part.folder}: cannot be removed yet: {error.strerror}; the next run removes it"
                        )


def tidy(place: Path, clear: Callable[[Part], object] | None = None) -> None:
    """Remove what a process that was killed has left beside a place, unless somebody is at work there.

    A part with finished shards stays, as far as `clear` leaves it.
    """
    target = resolved(place)
    if os.path.lexists(part_of(target)):
        with suppress(IbdataError), locked_part(target) as part:  # whose end removes the part
            if clear is not None:
                clear(part)


@contextmanager
def refusing_system_errors(place: str | os.PathLike[str], remedy: str = "") -> Iterator[None]:
    """Turn errors of the operating system, or of a store, into one line that names the place."""
    try:
        yield
    except OSError as error:
        raise IbdataError(f"{place}: cannot be written: {reason(error)}{remedy}") from error
    except MemoryError:
        raise IbdataError(
            f"{place}: out of memory; use fewer {WORKERS}, or a smaller output.shard_rows"
        ) from None
    except RuntimeError as error:
        if not is_thread_limit(error):
            raise
        raise IbdataError(
            f"{place}: the system starts no more threads; use fewer {WORKERS}, or raise ulimit -u"
        ) from error


@contextmanager
def _made_parents(target: Path) -> Iterator[None]:
    """Make the folders around a place; remove its part and those that were missing, if they are empty then.

    The lock is open until then, and a network's file system keeps the name of an open file.
    """
    missing = [folder for folder in target.parents if not folder.exists()]
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        for folder in missing:
            sync_folder(folder.parent)
        yield
    finally:
        for folder in (part_of(target), *missing):
            with suppress(OSError):  # it was not made, or is not empty
                folder.rmdir()
