"""A dataset comes to be in one way: in the hidden part beside its place, from which it is published.

A place has one dataset, and its part one run. The same command goes on with it; what another experiment,
other code or other bits have made or begun is refused in one line, or replaced with --overwrite. A dataset is
published by one rename; where one is replaced, the two change places in one system call.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from ibdata._system.files import keep_access, part_of, paths_in, remove, rename, sync_all
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
from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.errors import OUT, OVERWRITE, SHARDS, DatasetError, Interrupted, UsageError, notice
from ibdata.experiment.code import changed_here, names_of
from ibdata.experiment.dataset_spec import DatasetSpec, Shard
from ibdata.generation.finish import finish
from ibdata.generation.record import OTHER_BITS, UNREADABLE, Record
from ibdata.generation.shard import WrittenShard, all_written, has_size, is_whole, read_receipt


class Build:
    """The making of a dataset at a place.

    Attributes:
        spec: What is made.
        name: The place in messages.
        run: The folder of the run in the part, while that is open and something is missing.
    """

    def __init__(
        self,
        place: str | os.PathLike[str],
        spec: DatasetSpec,
        *,
        overwrite: bool = False,
        new: bool = False,
        name: str | None = None,
        record: Record | None = None,
        replaces: str | None = OVERWRITE,
    ) -> None:
        """Plan a dataset, with which `overwrite` replaces another one, and `new` refuses every other one.

        Messages name the option that `replaces` what is in the way, if there is one.
        """
        self.spec, self.name = spec, name or str(Path(place))
        self._is_made = False
        self._path, self._overwrite, self._new = resolved(place), overwrite, new
        self._part = Part(self._path)
        self._record, self._replaces = record, replaces

    @classmethod
    def begun(cls, place: str | os.PathLike[str]) -> tuple[Build, Record] | None:
        """The unfinished run at a place, and its record; None if there is none.

        Raises UsageError or DatasetError if another ibdata began it.
        """
        part = Part(resolved(place))
        with refusals(place):
            part.refuse_foreign()
            record = Record.read(part.run)
            if record.live if record else not manifest.is_unfinished(part):
                return None
        if record is None:
            raise DatasetError(f"{place}: holds an unfinished run {UNREADABLE}; remove {_shown(part.run)}")
        try:
            return cls(place, record.dataset_spec()), record
        except DatasetError as error:
            raise DatasetError(f"{place}: {error}, or remove {_shown(part.run)}") from None

    @property
    def run(self) -> Path:
        """The folder of the run in the part."""
        return self._part.run

    def look(self) -> bool:
        """Put in order what a killed process has left, then say what `is_there` says."""
        tidy(self._path, clear_useless)  # first, for what was to be replaced may lie in the part
        return self.is_there()

    def is_there(self) -> bool:
        """Whether the dataset is there, so that nothing is to be made. Nothing is written.

        Raises:
            UsageError: No dataset can appear here, or there is something else, finished or not.
            DatasetError: The dataset is damaged.
        """
        with refusals(self.name):
            _refuse_place(self._path, self.name)
            self._part.refuse_foreign()
            place = self._path if existing_paths(self._path) else self._part.folder / OLD  # to be restored
            is_in_the_way = not self._overwrite and manifest.is_unfinished(self._part)
            difference = self._difference() if is_in_the_way else None
            if not existing_paths(place):
                if difference:
                    raise self._refused_run(difference)
                return False
            if self._new:
                raise UsageError(f"{self.name}: exists already; choose another {OUT}")
            try:
                listed = manifest.read(place)
            except DatasetError as error:
                what = "a dataset of ibdata, left as it is"
                if not isinstance(error, manifest.NoDatasetError):
                    what = f"a dataset that this ibdata reads, left as it is ({error})"
                raise UsageError(f"{self.name}: not {what}; move it away, or choose another {OUT}") from None
            if self._overwrite:
                _refuse_files(place, listed)
                return False
            if other := other_dataset(listed, self.spec):
                way = f"{self._replaces} to replace" if self._replaces else f"remove {_shown(place)} to drop"
                if difference:
                    raise self._refused(f"{other}, and {self._run_in_words(difference)}", f"{way} both")
                raise self._refused(other, f"{way} it")
            refuse_damage(listed, partial(size_in, place), self.name)
            return True

    def begun_shards(self) -> int:
        """How many shards of this dataset are finished in the part, as far as the files of its code tell."""
        is_mine = manifest.is_unfinished(self._part) and self._difference() is None
        return len(self._part.receipts) if is_mine else 0

    def _difference(self) -> str | None:
        """How the run in the part differs from this one, as far as is known; None if it may go on."""
        begun = Record.read(self.run)
        return UNREADABLE if begun is None else begun.difference(self.spec, self._record)

    def _run_in_words(self, difference: str) -> str:
        done, shards = manifest.progress(self._part)
        return f"an unfinished run {difference}, {done} of {shards} shards"

    def _refused_run(self, difference: str) -> UsageError:
        """The error for a run in the part that is another one, and what a user can do about it."""
        done, shards = manifest.progress(self._part)
        ways = [f"remove {_shown(self.run)} to drop it"]
        if OTHER_BITS in difference:
            ways.insert(0, "a machine like the first goes on with it")
        if self._replaces:
            ways.append(f"{self._replaces} to replace it")
            if done == shards:
                ways.insert(0, f"ibdata finalize {self.name} finishes it")
        return self._refused(self._run_in_words(difference), ", ".join(ways))

    def _refused(self, what: str, ways: str) -> UsageError:
        return UsageError(f"{self.name}: holds {what}; {ways}, or choose another {OUT}")

    @contextmanager
    def open(self, record: Record, shared: bool = False) -> Iterator[None]:
        """Hold the part, perhaps with other hosts; begin the run of a record in it, or go on with it.

        Raises what `is_there` raises, and BusyError if another process holds the part.
        """
        self._record = record
        if shared:
            tidy(self._path, clear_useless)
        with locked_part(self._path, self.name, shared=shared) as self._part:
            try:
                if not shared:
                    clear_useless(self._part)
                self._is_made = self.is_there()
                if not self._is_made:
                    self._begin()
                yield
            except Interrupted as error:
                if done := self.finished:
                    how = "the same command goes on"
                    if self.spec.live:
                        how = "with an object of this session as a policy, a run begins again"
                    error.left = f"{'1 shard is' if done == 1 else f'{done} shards are'} finished; {how}"
                raise

    def _begin(self) -> None:
        """Begin the run, or go on with the one that is there; another one is refused or dropped."""
        if not self.run.exists() and self._make_folder():
            return
        if difference := self._difference():
            if not self._overwrite:
                raise self._refused_run(difference)
            notice(f"{self.name}: dropped {self._run_in_words(difference)}")
            self._part.clear()
            self._make_folder()

    def _make_folder(self) -> bool:
        """Fill the folder of the run under another name, and rename it; False if another host was faster."""
        new = self._part.folder / f"tmp-{secrets.token_hex(8)}"
        for folder in (new, new / DATASET, new / RECEIPTS):
            folder.mkdir()
        assert self._record is not None
        self._record.write(new)
        try:
            rename(new, self.run)
        except OSError:
            remove(new)
            if not self.run.exists():
                raise
            return False
        return True

    @property
    def finished(self) -> int:
        """How many shards of the run that is open are finished; their files are not looked at."""
        return len(self.spec.shards) if self._is_made else len(self._part.receipts)

    def missing(self, shards: Sequence[Shard] | None = None) -> list[Shard]:
        """The shards, of all or of these, without a receipt, or whose files are not as their receipts say."""
        if self._is_made:
            return []
        shards = self.spec.shards if shards is None else shards
        receipts = (read_receipt(self.run, shard) for shard in shards)
        whole = {written.shard for written in receipts if written is not None and is_whole(self.run, written)}
        return [shard for shard in shards if shard not in whole]

    def publish(self, is_right: Callable[[Path, WrittenShard], bool] = has_size) -> None:
        """Write the metadata, and give the dataset its name, in place of what is there.

        The note of the run first gets the checksum of the manifest. So whoever holds the part next can tell
        whether this was done.

        Raises IbdataError if a shard has no receipt that fits its file.
        """
        if self._is_made:
            return
        folder, record = self.run / DATASET, self._record
        assert record is not None
        remedy = f"run the same command again, or make them with {SHARDS}"
        written = all_written(self.run, self.spec.shards, self.name, remedy, is_right)
        paths = {shard.entry.path for shard in written}
        for file in (folder / "data").iterdir():
            if f"data/{file.name}" not in paths:  # of a shard that was made twice
                file.unlink()
        record.write(self.run)  # the manifest that was noted before is about to be written again
        finish(self.spec, written, folder, record.reproducible, record.code, record.clipped)
        sync_all(folder)
        if not self.is_there():  # somebody may have put files there meanwhile
            for path in [folder, *folder.rglob("*")]:  # as those of the dataset that is replaced
                old = self._path / path.relative_to(folder)
                keep_access(old if path.is_dir() else self._path / manifest.PATH, path)
            record.model_copy(update={"manifest": manifest.checksum_in(folder)}).write(self.run)
            self._part.place(folder, self._overwrite)
        with suppress(OSError):  # Windows removes no open file; who has the part next removes it
            self._part.clear()


def _refuse_place(path: Path, name: str) -> None:
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


def other_dataset(listed: Manifest, spec: DatasetSpec) -> str | None:
    """Whose dataset a manifest lists, in words; None if it is that of a specification."""
    if difference := spec.difference(listed.name, listed.experiments):
        return f"the dataset of another experiment ({difference})"
    if spec.live:
        return "the dataset of an object of a Python session"
    names = changed_here(spec, listed.code)
    return f"the dataset of this experiment with other code, in {names_of(names)}" if names else None


def size_in(folder: Path, path: str) -> int | None:
    """The bytes of a file in a folder; None if there is no such file."""
    file = folder / path
    return file.stat().st_size if file.is_file() else None


def refuse_damage(listed: Manifest, size_of: Callable[[str], int | None], name: str) -> None:
    """Raise DatasetError for the first file that a manifest lists and that is missing or has another size."""
    for path, entry in listed.entries().items():
        if size_of(path) != entry.bytes:
            raise DatasetError(
                f"{name}/{path}: missing or not whole, but the dataset is finished; ibdata repair makes the "
                f"file again, {OVERWRITE} the dataset"
            )


def _refuse_files(folder: Path, listed: Manifest) -> None:
    """Raise UsageError if more than a dataset is in its folder, or if a folder may not be replaced."""
    for path in foreign_files(folder, listed):
        what = "folder" if path.is_dir() else "file"
        raise UsageError(f"{path}: found a {what} that is not the dataset's; move it away")
    for parent in (folder.parent, folder, folder / "data", folder / "meta"):
        if not os.access(parent, os.W_OK | os.X_OK):
            raise UsageError(f"{parent}: cannot be written, expected a folder that {OVERWRITE} may replace")


def foreign_files(folder: Path, listed: Manifest) -> Iterator[Path]:
    """What is in a dataset's folder that is not the dataset's."""
    known = {*listed.entries(), manifest.PATH, manifest.SPLITS, manifest.CARD, manifest.REPORT}
    known |= {part_of(Path(path)).as_posix() for path in known}  # of a writer that was killed
    for path in paths_in(folder):
        if path.name in ("data", "meta") and path.is_dir():
            yield from (inner for inner in paths_in(path) if f"{path.name}/{inner.name}" not in known)
        elif not path.is_file() or path.name not in known:
            yield path


def clear_useless(part: Part) -> None:
    """Remove what is in a part, unless it is a run with which somebody may go on."""
    if not manifest.is_unfinished(part):
        part.clear()


def _shown(path: Path) -> Path:
    """A path as it is seen from the current folder."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
