"""The two kinds of places at which a dataset comes to be: a folder, and a store of objects at a URL.

In both, it is made in the hidden part beside the place, and appears when it is whole. In a folder it is
renamed, under a lock. A store has neither, but shards have names that say what is in them: whoever makes a
shard makes the same object, and what is copied twice is there once. The manifest is put there last.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ibdata._system.cache_folders import cache_folders
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
from ibdata._system.part import (
    DATASET,
    OLD,
    RECEIPTS,
    Part,
    existing_paths,
    locked_part,
    refusals,
    resolved,
    tidy,
)
from ibdata._system.runs import FolderRun, Run, StoreRun, note_of, runs_at
from ibdata._system.signals import ignore, stoppable
from ibdata._system.storage import Remote, Storage, url_of
from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.errors import OUT, OVERWRITE, BusyError, DatasetError, IbdataError, UsageError, notice, reason
from ibdata.generation.metadata import as_json
from ibdata.generation.record import Record
from ibdata.generation.shard import AT_ONCE, WrittenShard

UPLOAD = re.compile("[0-9a-f]{24}")  # what an older ibdata kept
SHARD = re.compile(r"data/part-[0-9]{5,}-[0-9a-f]+[.]parquet")
Documents = Iterable[tuple[str, bytes]]  # paths and contents of what is no shard, the manifest last


class Folder:
    """A folder. Its part has a lock, and is published by one rename.

    Attributes:
        name: The place in messages.
        files: The files of the place.
        replaces: Whether what is here can be replaced.
    """

    replaces = True

    def __init__(self, place: str | os.PathLike[str]) -> None:
        self.name, self._path = str(Path(place)), resolved(place)
        self.files = Storage(self._path)
        self._part = Part(self._path)
        self._found: Path | None = None

    def refuse(self, overwrite: bool) -> None:
        """Raise UsageError if no dataset can appear here, or if what is here cannot be replaced."""
        _refuse_folder(self._path, self.name)
        self._part.refuse_foreign()

    def found(self) -> Storage | None:
        """The files that are here; None if there are none, but for what a publication left half-done."""
        places = (self._path, self._part.folder / OLD)  # which is to be restored
        self._found = next((place for place in places if existing_paths(place)), None)
        return Storage(self._found) if self._found else None

    def size_of(self, path: str) -> int | None:
        """The bytes of a file that was found; None if it was not."""
        file = self._found / path if self._found else None
        return file.stat().st_size if file and file.is_file() else None

    def refuse_replacing(self, listed: Manifest) -> None:
        """Raise UsageError if more than a dataset is here, or if it may not be replaced."""
        folder = self._found or self._path
        for path in foreign_files(folder, listed):
            what = "folder" if path.is_dir() else "file"
            raise UsageError(f"{path}: found a {what} that is not the dataset's; move it away")
        for parent in (folder.parent, folder, folder / "data", folder / "meta"):
            if not os.access(parent, os.W_OK | os.X_OK):
                raise UsageError(
                    f"{parent}: cannot be written, expected a folder that {OVERWRITE} may replace"
                )

    def new_run(self, record: Record) -> Run:
        """The run that a record begins."""
        return FolderRun(self._part.run)

    @contextmanager
    def hold(self, shared: bool) -> Iterator[None]:
        """Keep others away as far as that is possible; `shared`: but not from other shards of the same."""
        if shared:
            self.tidy()
        with locked_part(self._path, self.name, shared=shared) as self._part:
            if not shared:
                self._clear_useless(self._part)
            yield

    def _clear_useless(self, part: Part) -> None:
        if not unfinished(self.files):
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
        """Bring together all files of the dataset; nobody takes them for one yet."""
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
        """Remove a run from the part."""
        self._part.clear()

    def tidy(self) -> None:
        """Remove what a process that was killed has left, unless somebody is at work here."""
        tidy(self._path, self._clear_useless)

    def shown(self, files: Run | Storage | None = None) -> str:
        """Where a run, or what was found, is to be removed by a user."""
        path = files.path if isinstance(files, Storage) else self._part.run
        return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)


class Store:
    """A store of objects at a URL, without locks and renames.

    Each run has a name in the part, which is only an address: equal commands begin the same run.
    """

    replaces = False

    def __init__(self, url: str) -> None:
        self.files = Remote(url)
        self.name = self.files.name
        if len(self.files.parts) < 2:
            raise UsageError(f"{self.name}: is a whole bucket, expected a name in it, as {self.name}/name")
        self._sizes: dict[str, int] = {}
        self._documents: dict[str, bytes] = {}

    def refuse(self, overwrite: bool) -> None:
        if overwrite:
            remedy = f"remove what is there, or choose another {OUT}"
            raise UsageError(f"{self.name}: {OVERWRITE} is for folders; {remedy}")
        refuse_name(self.files.parts, self.name)
        if self.files.folder is not None:
            manifest.refuse_inside(self.files.folder)
        if (around := self.files.around(manifest.PATH)) is not None:
            raise UsageError(f"{self.name}: lies within the dataset {around}; choose a place outside of it")

    def found(self) -> Storage | None:
        try:
            self._sizes = self.files.sizes()
            if manifest.PATH not in self._sizes:
                if self._publishing():
                    return None
                self._sizes = self.files.sizes()  # a run may have ended since the first look
        except OSError as error:
            raise DatasetError(f"{self.name}: cannot be read: {reason(error)}") from None
        return self.files if self._sizes else None

    def size_of(self, path: str) -> int | None:
        return self._sizes.get(path)

    def refuse_replacing(self, listed: Manifest) -> None:
        """Nothing is replaced here."""

    def _publishing(self) -> list[StoreRun]:
        """The runs whose files are being copied to the place, or were until a kill."""
        return [run for run in self._runs() if note_of(run).get("manifest")]

    def _runs(self) -> list[StoreRun]:
        return [run for run in runs_at(self.files) if isinstance(run, StoreRun)]

    def new_run(self, record: Record) -> Run:
        content = secrets.token_bytes(8) if record.live else as_json(record)
        return StoreRun(self.files.part.below(hashlib.sha256(content).hexdigest()[:16]))

    @contextmanager
    def hold(self, shared: bool) -> Iterator[None]:
        self._forget_uploads()
        with refusals(self.name, "; the same command goes on"), stoppable():
            yield

    def _forget_uploads(self) -> None:
        """Remove what an older ibdata has left, which made datasets here before it uploaded them."""
        uploads = Path(cache_folders().folders[-1], "uploads")
        for folder in existing_paths(uploads):
            if UPLOAD.fullmatch(folder.name):
                shutil.rmtree(folder, ignore_errors=True)
                notice(f"{folder}: removed what an older ibdata had kept for an upload; it is made again")
        with suppress(OSError):
            uploads.rmdir()

    def begin(self, run: Run, record: Record) -> bool:
        if note_of(run):
            return False
        record.write(run)
        return True

    def gather(self, run: Run, record: Record, written: list[WrittenShard], documents: Documents) -> None:
        """Note the checksum of the manifest, and copy all but the manifest to the place.

        Two runs that do so at once both note it before they look for others, so at least one sees the other.
        """
        made, self._documents = run.dataset(), dict(documents)
        assert isinstance(made, Remote)
        noted, checksum = note_of(run).get("manifest"), json.loads(self._documents[manifest.PATH])["checksum"]
        if noted != checksum:
            record.model_copy(update={"manifest": checksum}).write(run)
        others = [other for other in self._publishing() if other.name != run.name]
        is_taken = self.files.size(manifest.PATH) is not None  # then others may be removed already
        if (others or is_taken) and noted is None:
            record.write(run)
        if is_taken:
            return
        if others:
            raise BusyError(
                f"{self.name}: another run is being published here, or was until a kill; the same command as "
                f"then goes on with it, else remove {self.shown(others[0])}"
            )
        shards, found = {shard.entry.path: shard.entry.bytes for shard in written}, self.files.sizes()
        for path in sorted(found.keys() - shards.keys() - self._documents.keys()):
            if not SHARD.fullmatch(path):
                strange = f"{self.files.where(path)}: found a file that is not the dataset's"
                raise UsageError(f"{strange}; move it away")
            self.files.remove(path)  # which a run that nobody goes on with has left
        missing = [path for path, size in shards.items() if found.get(path) != size]
        with ThreadPoolExecutor(AT_ONCE) as threads:
            list(threads.map(lambda path: self.files.copy_from(made, path), missing))
        for path, data in self._documents.items():
            if path != manifest.PATH:
                self.files.put_bytes(data, path)

    def appear(self, run: Run, record: Record, replace: bool) -> None:
        self.files.put_bytes(self._documents[manifest.PATH], manifest.PATH)

    def clear(self, run: Run) -> None:
        assert isinstance(run, StoreRun)
        ignore()  # the dataset is there
        try:
            self._remove(run)
        except OSError as error:
            notice(f"{run.name}: cannot be removed: {reason(error)}; it is needed no more, remove it")

    def tidy(self) -> None:
        with suppress(OSError, IbdataError):
            checksum = manifest.checksum_in(self.files)
            published = [run for run in self._runs() if note_of(run).get("manifest") == checksum]
            for run in published if checksum else ():
                self._remove(run)

    def _remove(self, run: StoreRun) -> None:
        run.remove()
        if not self.files.part.names(""):
            self.files.part.remove()  # an empty folder, or the mark that pyarrow leaves for one

    def shown(self, files: Run | Storage | None = None) -> str:
        return self.name if files is None else files.name


Place = Folder | Store


def place_at(place: Any) -> Place:
    """The place that a path or a URL names."""
    url = url_of(place)
    return Folder(place) if url is None else Store(url)


def unfinished(files: Storage) -> list[Run]:
    """The runs beside a place that have finished shards, with which somebody may go on."""
    return [run for run in runs_at(files) if manifest.is_unfinished(run, files)]


def just_begun(files: Storage) -> list[Run]:
    """The runs beside a place that have no finished shard yet."""
    return [run for run in runs_at(files) if not run.receipts() and note_of(run).get("live") is False]


def _refuse_folder(path: Path, name: str) -> None:
    """Raise UsageError if no dataset can appear at a place by a rename."""
    manifest.refuse_inside(path)
    refuse_name(Path(name).parts, name)
    here = Path.cwd()
    around = [each for each in (here, *here.parents) if str(each).lower() == str(path).lower()]
    if path in around or (path.exists() and any(map(path.samefile, around))):  # macOS has names in any case
        raise UsageError(f"{name}: is the current folder or around it; choose another {OUT}")
    if os.path.ismount(path):
        raise UsageError(f"{name}: is a mount point, which cannot be replaced; choose a folder in it")
    there = next(each for each in (path, *path.parents) if os.path.lexists(each))
    if not there.is_dir():
        where = "is" if there == path else "lies in"
        raise UsageError(f"{name}: {where} a file, not a folder; choose another {OUT}")


def refuse_name(parts: Sequence[str], place: str | os.PathLike[str]) -> None:
    """Raise UsageError for a place whose name readers take for a column, or for a single Parquet file."""
    manifest.refuse_partition(parts, place)
    if parts and parts[-1].lower().endswith(".parquet"):
        raise UsageError(
            f"{place}: found the ending .parquet, but a dataset is a folder; leave .parquet out (read its "
            "files at data/*.parquet)"
        )


def foreign_files(folder: Path, listed: Manifest) -> Iterator[Path]:
    """What is in a dataset's folder that is not the dataset's."""
    known = {*listed.entries(), manifest.PATH, manifest.SPLITS, manifest.CARD, manifest.REPORT}
    known |= {part_of(Path(path)).as_posix() for path in known}  # of a writer that was killed
    for path in paths_in(folder):
        if path.name in ("data", "meta") and path.is_dir():
            yield from (inner for inner in paths_in(path) if f"{path.name}/{inner.name}" not in known)
        elif not path.is_file() or path.name not in known:
            yield path
