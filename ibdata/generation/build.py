"""A dataset comes to be in one way, in a folder or a store: in the part beside its place, until it is whole.

A place has one dataset, and its part one run. The same command goes on with it; what another experiment,
other code or other bits have made or begun is refused in one line, or in a folder replaced with --overwrite.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

from ibdata._system.part import refusing_system_errors
from ibdata._system.runs import Run
from ibdata._system.storage import Storage
from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.errors import OUT, OVERWRITE, SHARDS, DatasetError, IbdataError, Interrupted, UsageError, notice
from ibdata.generation.finish import finish
from ibdata.generation.place import place_at, refuse_damage
from ibdata.generation.record import OTHER_BITS, UNREADABLE, Record
from ibdata.generation.shard import all_written, finished_shards
from ibdata.plan.code_record import changed_here, names_of
from ibdata.plan.dataset_spec import DatasetSpec, Shard


class Build:
    """The making of a dataset at a place.

    Attributes:
        spec: What is made.
        name: The place in messages.
        run: The run in the part, while that is open and something is missing.
    """

    run: Run

    def __init__(
        self,
        place: str | os.PathLike[str],
        spec: DatasetSpec,
        *,
        overwrite: bool = False,
        new: bool = False,
        record: Record | None = None,
        replaces: str = OVERWRITE,
    ) -> None:
        """Plan a dataset, with which `overwrite` replaces another one, and `new` refuses every other one.

        Messages name the option that `replaces` what is in the way, where the place can be replaced.
        """
        self.spec, self._place = spec, place_at(place)
        self.name = self._place.name
        self._is_made = self._has_begun = False
        self._overwrite, self._new = overwrite, new
        self._record = record
        self._replaces = replaces if self._place.replaces and not new else None

    @classmethod
    def begun(cls, place: str | os.PathLike[str]) -> tuple[Build, Record] | None:
        """The unfinished run at a place, and its record; None if there is none.

        Raises UsageError or DatasetError if another ibdata began it, or if a store has several.
        """
        where = place_at(place)
        with refusing_system_errors(where.name):
            where.refuse(overwrite=False)
            runs = manifest.unfinished(where.files) or manifest.just_begun(where.files)
        if not runs:
            return None
        run = where.shown(runs[0])
        if len(runs) > 1:
            several = f"found {len(runs)} unfinished runs, expected one"
            raise UsageError(f"{where.name}: {several}; remove the other, such as {run}")
        if (record := Record.read(runs[0])) is None:
            raise DatasetError(f"{where.name}: holds an unfinished run {UNREADABLE}; remove {run}")
        try:
            return cls(place, record.dataset_spec()), record
        except DatasetError as error:
            raise DatasetError(f"{where.name}: {error}, or remove {run}") from None

    def look(self, tidy: bool = False) -> bool:
        """Say whether the dataset is there, so that nothing is to be made; refuse what is in its way.

        Nothing is written; but with `tidy`, what a killed process has left is put in order first.

        Raises:
            UsageError: No dataset can appear here, or there is something else, finished or not.
            DatasetError: The dataset is damaged.
        """
        if tidy:
            self._place.tidy()  # what was to be replaced may lie in the part
        with refusing_system_errors(self.name):
            self._place.refuse(self._overwrite)
            other_run = None if self._overwrite or self._has_begun else self._other_run()
            if found := self._place.found():
                self._refuse_unlike(found, other_run)
            elif other_run:
                raise self._refused_run(*other_run)
            return found is not None and not self._overwrite

    def _refuse_unlike(self, found: Storage, other_run: tuple[Run, str] | None) -> None:
        """Raise an error unless what was found is the dataset, and whole, or may be replaced."""
        if self._new:
            raise UsageError(f"{self.name}: exists already; choose another {OUT}")
        listed = self._listed(found)
        if self._overwrite:
            self._place.refuse_replacing(listed)
            return
        if other := other_dataset(listed, self.spec):
            way = f"remove {self._place.shown(found)} to drop"
            if self._replaces:
                way = f"{self._replaces} to replace"
            if other_run:
                raise self._refused(f"{other}, and {_in_words(*other_run)}", f"{way} both")
            raise self._refused(other, f"{way} it")
        refuse_damage(listed, self._place)

    def _listed(self, found: Storage) -> Manifest:
        try:
            return manifest.read(found)
        except DatasetError as error:
            what = "a dataset of ibdata, left as it is"
            if not isinstance(error, manifest.NoDatasetError):
                what = f"a dataset that this ibdata reads, left as it is ({error})"
            raise UsageError(f"{self.name}: not {what}; move it away, or choose another {OUT}") from None

    def begun_shards(self) -> int:
        """How many shards of this dataset are finished in the part, as far as the files of its code tell."""
        return max((len(run.receipts()) for run, difference in self._runs() if difference is None), default=0)

    def _runs(self) -> list[tuple[Run, str | None]]:
        """The unfinished runs in the part, and how each differs from this one."""
        return [(run, self._difference(run)) for run in manifest.unfinished(self._place.files)]

    def _other_run(self) -> tuple[Run, str] | None:
        """A run in the part that is another one, and how it differs."""
        return next(((run, difference) for run, difference in self._runs() if difference), None)

    def _difference(self, run: Run) -> str | None:
        """How a run in the part differs from this one, as far as is known; None if it may go on."""
        begun = Record.read(run)
        return UNREADABLE if begun is None else begun.difference(self.spec, self._record)

    def _refused_run(self, run: Run, difference: str) -> UsageError:
        """The error for a run in the part that is another one, and what a user can do about it."""
        ways = [f"remove {self._place.shown(run)} to drop it"]
        if OTHER_BITS in difference:
            ways.insert(0, "a machine like the first goes on with it")
        if self._replaces:
            ways.append(f"{self._replaces} to replace it")
        if not self._new:
            done, shards = manifest.progress(run)
            if done == shards:
                ways.insert(0, f"ibdata finalize {self.name} finishes it")
        return self._refused(_in_words(run, difference), ", ".join(ways))

    def _refused(self, what: str, ways: str) -> UsageError:
        return UsageError(f"{self.name}: holds {what}; {ways}, or choose another {OUT}")

    @contextmanager
    def open(self, record: Record, shared: bool = False) -> Iterator[None]:
        """Hold the part, perhaps with other hosts; begin the run of a record in it, or go on with it.

        Raises what `look` raises, and BusyError if another process holds the part.
        """
        self._record = record
        with self._place.hold(shared):
            try:
                self._is_made = self.look()
                if not self._is_made:
                    self._begin()
                    self._has_begun = True
                yield
            except BaseException as error:
                if self._has_begun and self.spec.live:
                    with suppress(OSError):
                        self._place.clear(self.run)  # nobody can go on with it
                elif isinstance(error, Interrupted) and (done := self.finished):
                    shards = "1 shard is" if done == 1 else f"{done} shards are"
                    error.left = f"{shards} finished; the same command goes on"
                raise

    def _begin(self) -> None:
        """Begin the run, or go on with the one that is there; another one is refused or dropped."""
        record = self._record
        assert record is not None
        own = (run for run, difference in self._runs() if difference is None)
        self.run = next(own, None) or self._place.new_run(record)
        if self._place.begin(self.run, record):
            return
        if difference := self._difference(self.run):
            if not self._overwrite:
                raise self._refused_run(self.run, difference)
            notice(f"{self.name}: dropped {_in_words(self.run, difference)}")
            self._place.clear(self.run)
            self._place.begin(self.run, record)

    @property
    def finished(self) -> int:
        """How many shards of the run that is open are finished; their files are not looked at."""
        return len(self.spec.shards) if self._is_made else len(self.run.receipts())

    def missing(self, shards: Sequence[Shard] | None = None) -> list[Shard]:
        """The shards, of all or of these, without a receipt, or whose files are not as their receipts say."""
        if self._is_made:
            return []
        shards = self.spec.shards if shards is None else shards
        whole = {written.shard for written in finished_shards(self.run, shards, closely=True)}
        return [shard for shard in shards if shard not in whole]

    def is_published(self) -> bool:
        """Whether another host has published the dataset meanwhile; then what was made here is removed."""
        if self._is_made or not self.look():
            return self._is_made
        self._place.clear(self.run)
        return True

    def publish(self, closely: bool = False) -> None:
        """Write the metadata, and give the dataset its name, in place of what is there.

        Raises IbdataError if a shard has no receipt that fits its file; `closely`, by its content.
        """
        if self._is_made:
            return
        try:
            self._gather(closely)
        except (OSError, IbdataError):
            is_published = False
            with suppress(OSError, IbdataError):
                is_published = self.look()  # by another host meanwhile, which has removed the run
            if not is_published:
                raise
        if not self.look():  # somebody may have put files there meanwhile
            assert self._record is not None
            self._place.appear(self.run, self._record, self._overwrite)
        with suppress(OSError):  # Windows removes no open file; who has the part next removes it
            self._place.clear(self.run)

    def _gather(self, closely: bool) -> None:
        record, remedy = self._record, f"ibdata generate makes them, as before, alone or with {SHARDS}"
        assert record is not None
        written = all_written(self.run, self.spec.shards, self.name, remedy, closely)
        documents = finish(self.spec, written, record.reproducible, record.code, record.clipped)
        self._place.gather(self.run, record, written, documents)


def _in_words(run: Run, difference: str) -> str:
    done, shards = manifest.progress(run)
    return f"an unfinished run {difference}, {done} of {shards} shards"


def other_dataset(listed: Manifest, spec: DatasetSpec) -> str | None:
    """Whose dataset a manifest lists, in words; None if it is that of a specification."""
    if difference := spec.difference(listed.name, listed.experiments):
        return f"the dataset of another experiment ({difference})"
    if spec.live:
        return "the dataset of an object of a Python session"
    names = changed_here(spec, listed.code)
    return f"the dataset of this experiment with other code, in {names_of(names)}" if names else None
