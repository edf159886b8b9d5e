"""Making a dataset in the hidden part beside its place, from which it is published."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ibdata.errors import Interrupted, notice
from ibdata.experiment import load
from ibdata.experiment.code import live_objects
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.generation.process import Process, process_for
from ibdata.generation.publish import publish, recover
from ibdata.generation.record import EXPERIMENT, Record, difference, observe
from ibdata.generation.target import Action, At, Begun, Found, Mode, Target, decide, look
from ibdata.generation.workers import Engine
from ibdata.system.part import Part, locked_part
from ibdata.system.progress import Progress
from ibdata.writing.finish import finish
from ibdata.writing.shard import DATASET, WrittenShard, all_written, has_size, is_whole, read_receipt


class Job:
    """A run that makes the dataset of a specification at a target.

    Attributes:
        part: The part of the target, which this process holds in `locked`.
        record: The record of the run, once it is known.
    """

    def __init__(
        self, target: Target, spec: DatasetSpec, mode: Mode = Mode.NEW, progress: Progress | None = None
    ) -> None:
        self.target, self.spec, self.mode = target, spec, mode
        self.progress = progress or Progress()
        self.part: Part
        self.record: Record

    @classmethod
    def begun_in(cls, part: Part, target: Target) -> Job | None:
        """The job that was begun in a part, which this process holds; None if there is none."""
        record = Record.read(part.folder)
        if record is None:
            return None
        job = cls(target, DatasetSpec.of(load(part.folder / EXPERIMENT)))
        job.part, job.record = part, record
        return job

    def is_there(self) -> bool:
        """Whether the dataset is finished at its target. Raises what `decide` raises for another one."""
        found = look(self.target, self.spec)
        if decide(found, self.mode) is not Action.OPEN:
            return False
        if found.other_code:
            notice(f"{self.target.name}: was made with other code than is here, in {found.other_code}")
        return True

    def run(self, engine: Engine) -> None:
        """Make the dataset, unless it is there."""
        with process_for(self.spec) as process:
            self.record = process.call(observe)  # a signal may end the process: nothing is written yet
            with self.locked():
                if self.begin() is not Action.OPEN:
                    self.make(process, engine, self.spec.shards)
                    self.finish()

    @contextmanager
    def locked(self, shared: bool = False) -> Iterator[None]:
        """Hold the part, perhaps with other hosts. A signal's exception says what is left in it."""
        with locked_part(self.target.path, self.target.name, shared=shared) as self.part:
            try:
                yield
            except Interrupted as error:
                if count := len(self.part.receipts):
                    shards = "1 shard is" if count == 1 else f"{count} shards are"
                    error.left = f"{shards} finished; {self._how_to_go_on(shared)}"
                raise

    def _how_to_go_on(self, shared: bool) -> str:
        if live_objects(self.spec):
            return "with an object of this session as a policy, a run begins again"
        if shared:
            return "--shards goes on"
        return "--overwrite goes on" if self.mode is Mode.OVERWRITE else "--resume goes on"

    def begin(self) -> Action:
        """Begin the run in the part, or go on with the one that is in it, as `decide` says."""
        recover(self.part)
        found = look(self.target, self.spec, self.record, with_part=True)
        action = decide(found, self.mode)
        if action is Action.DISCARD:
            notice(f"{self.target.name}: the unfinished run {found.run} that was begun here is discarded")
        if action in (Action.BEGIN, Action.DISCARD):
            self.part.clear()
            self._folder.mkdir()
            self.record.begin(self.part.folder, self.spec)
        return action

    def join(self) -> Action:
        """Begin the run as the first host, or join the one that another has begun; then share the part."""
        if self.part.lock.take_alone() and self.begin() is Action.OPEN:
            return Action.OPEN
        self.part.share()
        run = difference(self.part.folder, self.spec.experiments[0], self.record)
        begun = Begun.SAME if run is None else Begun.OTHER
        return decide(Found(self.target.name, At.FREE, begun, run=run), self.mode)

    def missing(self, shards: Sequence[Shard]) -> list[Shard]:
        """The shards of which the part has no receipt, or whose files are not as their receipts say."""
        root = self.part.folder
        receipts = (read_receipt(root, shard) for shard in shards)
        whole = {written.shard for written in receipts if written is not None and is_whole(root, written)}
        return [shard for shard in shards if shard not in whole]

    def make(self, process: Process, engine: Engine, shards: Sequence[Shard]) -> None:
        """Make the shards that are missing."""
        missing = self.missing(shards)
        rows = self.spec.rows_in(shards)
        with self.progress.bar(rows, rows - self.spec.rows_in(missing)):
            for number in engine(process, missing, self.part.folder, self.progress.reach):
                self.progress.reach(number, self.spec.rows_in([self.spec.shards[number]]))

    def written(self, is_right: Callable[[Path, WrittenShard], bool] = has_size) -> list[WrittenShard]:
        """All shards, from their receipts. Raises IbdataError if one has none that fits its file."""
        remedy = "run again with --resume, or make them with --shards"
        return all_written(self.part.folder, self.spec.shards, self.target.name, remedy, is_right)

    def finish(self, is_right: Callable[[Path, WrittenShard], bool] = has_size) -> None:
        """Publish the dataset, of which all shards are made."""
        written = self.written(is_right)
        paths = {shard.entry.path for shard in written}
        for file in (self._folder / "data").iterdir():
            if f"data/{file.name}" not in paths:  # of a shard that was made twice
                file.unlink()
        finish(self.spec, written, self._folder, self.record.reproducible, self.record.code)
        decide(look(self.target, self.spec), self.mode)  # somebody may have put files there meanwhile
        publish(self.part)

    @property
    def _folder(self) -> Path:
        """The folder in the part in which the dataset is made."""
        return self.part.folder / DATASET
