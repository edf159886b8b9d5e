"""The context for everything that writes to a folder: a lock, signals as exceptions, one-line errors."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import TypeVar

from ibdata.errors import IbdataError, is_thread_limit
from ibdata.system.atomic_files import sync_folder
from ibdata.system.lock import locked
from ibdata.system.signals import stoppable

Held = TypeVar("Held")


@contextmanager
def writing_to(
    folder: Path,
    lock: Callable[[Path], AbstractContextManager[Held]] = locked,  # type: ignore[assignment]
    name: Path | None = None,
) -> Iterator[Held]:
    """Write to a folder, which is made if it is missing, as its only writer.

    Args:
        folder: The folder to which the block writes; if it is new and empty afterwards, it is removed.
        lock: How to lock the folder: `locked`, or `shared` with writers of other parts.
        name: The folder's name in messages; by default its path.

    Raises:
        BusyError: Another process writes to the folder.
        Interrupted: A signal asked to stop.
        IbdataError: The system refuses to write, or there is not enough memory.
    """
    with refusals(name or folder), stoppable(), made_folder(folder), lock(folder) as held:
        yield held


@contextmanager
def refusals(folder: Path) -> Iterator[None]:
    """Turn errors of the operating system into one line that names the folder."""
    try:
        yield
    except OSError as error:
        raise IbdataError(f"{folder}: cannot be written: {error.strerror or error}") from error
    except MemoryError:
        raise IbdataError(
            f"{folder}: out of memory; use fewer --workers, or a smaller output.shard_rows"
        ) from None
    except RuntimeError as error:
        if not is_thread_limit(error):
            raise
        raise IbdataError(
            f"{folder}: the system starts no more threads; use fewer --workers, or raise ulimit -u"
        ) from error


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make the folder and its parents; remove those that were missing and are empty afterwards."""
    missing = [path for path in (folder, *folder.parents) if not os.path.exists(path)]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path in missing:
            sync_folder(path.parent)
        yield
    finally:
        for path in missing:
            with suppress(OSError):  # it was not made, or is not empty
                path.rmdir()
