"""A folder as the place at which a dataset comes to be: in the hidden part beside it, under a lock.

The dataset appears by one rename; where one is replaced, the two change places in one system call.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from ibdata._system.files import (
    keep_access,
    part_of,
    paths_in,
    remove,
    rename,
    sync_all,
    sync_folder,
    write_new,
)
from ibdata._system.part import DATASET, OLD, RECEIPTS, Part, existing_paths, locked_part, resolved, tidy
from ibdata._system.runs import FolderRun, Run
from ibdata._system.storage import Storage
from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.errors import OUT, OVERWRITE, UsageError
from ibdata.generation.record import Record
from ibdata.generation.shard import WrittenShard

Documents = Iterable[tuple[str, bytes]]  # paths and contents of what is no shard, the manifest last


class Folder:
    """A `BuildPlace` whose part has a lock, and is published by one rename."""

    replaces = True

    def __init__(self, place: str | os.PathLike[str]) -> None:
        self.name, self._path = str(Path(place)), resolved(place)
        self.files = Storage(self._path)
        self._part = Part(self._path)
        self._found: Path | None = None

    def refuse(self, overwrite: bool) -> None:
        path, here = self._path, Path.cwd()
        manifest.refuse_inside(path)
        manifest.refuse_name(Path(self.name).parts, self.name)
        around = [each for each in (here, *here.parents) if str(each).lower() == str(path).lower()]
        if path in around or (path.exists() and any(map(path.samefile, around))):  # macOS: names in any case
            raise UsageError(f"{self.name}: is the current folder or around it; choose another {OUT}")
        if os.path.ismount(path):
            raise UsageError(
                f"{self.name}: is a mount point, which cannot be replaced; choose a folder in it"
            )
        there = next(each for each in (path, *path.parents) if os.path.lexists(each))
        if not there.is_dir():
            where = "is" if there == path else "lies in"
            raise UsageError(f"{self.name}: {where} a file, not a folder; choose another {OUT}")
        self._part.refuse_foreign()

    def found(self) -> Storage | None:
        places = (self._path, self._part.folder / OLD)  # which is to be restored
        self._found = next((place for place in places if existing_paths(place)), None)
        return Storage(self._found) if self._found else None

    def size_of(self, path: str) -> int | None:
        file = self._found / path if self._found else None
        return file.stat().st_size if file and file.is_file() else None

    def refuse_replacing(self, listed: Manifest) -> None:
        folder = self._found or self._path
        for path in _foreign_files(folder, listed):
            what = "folder" if path.is_dir() else "file"
            raise UsageError(f"{path}: found a {what} that is not the dataset's; move it away")
        for parent in (folder.parent, folder, folder / "data", folder / "meta"):
            if not os.access(parent, os.W_OK | os.X_OK):
                raise UsageError(
                    f"{parent}: cannot be written, expected a folder that {OVERWRITE} may replace"
                )

    def new_run(self, record: Record) -> Run:
        return FolderRun(self._part.run)

    @contextmanager
    def hold(self, shared: bool) -> Iterator[None]:
        if shared:
            self.tidy()
        with locked_part(self._path, self.name, shared=shared) as self._part:
            if not shared:
                self._clear_useless(self._part)
            yield

    def _clear_useless(self, part: Part) -> None:
        if not manifest.unfinished(self.files):
            part.clear()

    def begin(self, run: Run, record: Record) -> bool:
        """Fill the folder of the run under another name, and rename it."""
        final, new = self._part.run, self._part.folder / f"tmp-{secrets.token_hex(8)}"
        if final.exists():
            return False
        for folder in (new, new / DATASET, new / RECEIPTS):
            folder.mkdir()
        record.write(FolderRun(new))
        try:
            rename(new, final)
        except OSError:
            remove(new)
            if not final.exists():
                raise
            return False  # another host was faster
        return True

    def gather(self, run: Run, record: Record, written: list[WrittenShard], documents: Documents) -> None:
        folder, paths = self._part.run / DATASET, {shard.entry.path for shard in written}
        for file in (folder / "data").iterdir():
            if f"data/{file.name}" not in paths:  # of a shard that was made again, and got other bytes
                file.unlink()
        record.write(run)  # the manifest that was noted before is about to be written again
        for path, data in documents:
            write_new(folder, path, data, waits=False)
        sync_all(folder)

    def appear(self, run: Run, record: Record, replace: bool) -> None:
        """First note the checksum of the manifest, by which whoever comes next sees that this was done."""
        folder = self._part.run / DATASET
        for path in [folder, *folder.rglob("*")]:  # as those of the dataset that is replaced
            old = self._path / path.relative_to(folder)
            keep_access(old if path.is_dir() else self._path / manifest.PATH, path)
        record.model_copy(update={"manifest": manifest.checksum_in(Storage(folder))}).write(run)
        sync_folder(self._part.run)
        self._part.place(folder, replace)

    def clear(self, run: Run) -> None:
        self._part.clear()

    def tidy(self) -> None:
        tidy(self._path, self._clear_useless)

    def shown(self, files: Run | Storage) -> str:
        path = files.path if isinstance(files, Storage) else self._part.run
        return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)


def _foreign_files(folder: Path, listed: Manifest) -> Iterator[Path]:
    """What is in a dataset's folder that is not the dataset's."""
    known = {*listed.entries(), manifest.PATH, manifest.SPLITS, manifest.CARD, manifest.REPORT}
    known |= {part_of(Path(path)).as_posix() for path in known}  # of a writer that was killed
    for path in paths_in(folder):
        if path.name in ("data", "meta") and path.is_dir():
            yield from (inner for inner in paths_in(path) if f"{path.name}/{inner.name}" not in known)
        elif not path.is_file() or path.name not in known:
            yield path
