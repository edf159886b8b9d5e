"""Making the dataset of one experiment at its place: in a hidden part beside it, then published."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from ibdata.errors import IbdataError, Interrupted, UsageError, notice
from ibdata.experiment import Experiment
from ibdata.experiment.code import changed_here, live_objects, names_of
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.generation import origin, receipt
from ibdata.generation.engine import Run
from ibdata.generation.origin import Origin
from ibdata.generation.publish import publish, settle
from ibdata.generation.target import TakenError, present, refuse_incomplete, size_in
from ibdata.generation.worker import Process, process_for
from ibdata.system.part import Part, locked_part
from ibdata.system.progress import Advance, bar
from ibdata.writing.finish import finish
from ibdata.writing.shard_writer import WrittenShard


def make_dataset(
    experiment: Experiment,
    target: Path,
    place: Path,
    run: Run,
    resume: bool = False,
    overwrite: bool = False,
    progress: bool | None = False,
) -> None:
    """Make the dataset of an experiment at a place, unless it is there. Messages name it `place`."""
    spec = DatasetSpec.of(experiment)
    with process_for(spec) as process:
        here = process.call(origin.observe)  # a signal may end the process, since nothing is written yet
        with (
            locked_part(target, place) as part,
            counted_if_stopped(part, spec, "--overwrite" if overwrite else "--resume"),
        ):
            settle(part)
            if already_there(experiment, target, place, resume, overwrite):
                return
            prepare(part, spec, here, place, resume, overwrite)
            make(process, spec.shards, part, run, progress)
            written = receipt.all_of(part.folder, spec.shards, place, "--resume makes them again")
            drop_others(part, written)
            finish(spec, written, part.folder / receipt.DATASET, here.reproducible, here.code)
            present(target, place, experiment, overwrite)  # somebody may have put files there meanwhile
            publish(part)


def refuse_both(resume: bool, overwrite: bool) -> None:
    """Raise UsageError where a run is to go on and to begin again."""
    if resume and overwrite:
        raise UsageError("--resume and --overwrite exclude each other; give one of them")


def already_there(experiment: Experiment, target: Path, place: Path, resume: bool, overwrite: bool) -> bool:
    """Whether the dataset is finished. Raises UsageError if another one may not be replaced.

    Other code of its policies is an error, and with `resume` a warning, since nothing would run.
    """
    listed = present(target, place, experiment, overwrite)
    if listed is None:
        return False
    refuse_incomplete(listed, partial(size_in, target), place)
    names = changed_here(DatasetSpec.of(experiment), listed.code)
    if names and not resume:
        raise TakenError(
            f"{place}: holds the dataset of this experiment with other code, in {names_of(names)}; "
            "--overwrite to make it again"
        )
    if names:
        notice(f"{place}: was made with other code than is here, in {names_of(names)}")
    return True


def settle_left(target: Path) -> None:
    """Remove the part of a dataset that is there, if its run was killed after it had published it."""
    part = Part(target)
    began = origin.read(part.folder)  # None too where a kill has left a part without its note
    if part.folder.exists() and (began is None or began.manifest is not None):
        with suppress(IbdataError), locked_part(target) as part:
            settle(part)


def prepare(
    part: Part, spec: DatasetSpec, here: Origin, place: Path, resume: bool, overwrite: bool = False
) -> None:
    """Begin a run in a part, or go on with the one that is in it.

    Raises TakenError if the options do not say which, and UsageError if it cannot go on.
    """
    if part.receipts:
        other = origin.other(part.folder, spec.experiments[0], here)
        if other is None and (resume or overwrite):
            return
        if not overwrite:
            raise unfinished(place, other, resume)
        notice(f"{place}: the unfinished run {other} that was begun here is discarded")
    part.clear()
    (part.folder / receipt.DATASET).mkdir()
    origin.begin(part.folder, spec, here)


def unfinished(place: Path, other: str | None, resume: bool) -> UsageError:
    """The error for an unfinished run that the options do not fit; `other` says how it differs."""
    if other is None:
        return TakenError(f"{place}: holds an unfinished run; --resume to go on with it")
    kind = UsageError if resume else TakenError
    return kind(
        f"{place}: holds an unfinished run {other}; --overwrite to start again, or choose another --out"
    )


def make(process: Process, shards: list[Shard], part: Part, run: Run, progress: bool | None) -> None:
    """Make the shards of which the part has no receipt, or whose files are not as their receipts say."""
    spec, missing, done = process.spec, [], 0
    for shard in shards:
        written = receipt.get(part.folder, shard)
        if written is None or not receipt.is_whole(part.folder, written):
            missing.append(shard)
        else:
            done += rows_of(spec, [shard])
    with bar(progress, rows_of(spec, shards), "transitions") as advance:
        advance(done)
        counted = _Counted(advance)
        for number in run(process, missing, part.folder, counted.tell):
            counted.tell(number, rows_of(spec, [spec.shards[number]]))


def rows_of(spec: DatasetSpec, shards: list[Shard]) -> int:
    """The number of rows of shards."""
    return sum((shard.stop - shard.first) * spec.of_shard(shard).steps for shard in shards)


def drop_others(part: Part, written: list[WrittenShard]) -> None:
    """Remove the files in `data` that are none of a dataset's: its shards that were made twice."""
    known = {each.entry.path for each in written}
    for path in (part.folder / receipt.DATASET / "data").iterdir():
        if f"data/{path.name}" not in known:
            path.unlink()


@contextmanager
def counted_if_stopped(part: Part, spec: DatasetSpec, option: str) -> Iterator[None]:
    """Let a signal's exception say what is left behind; `option` is the one that goes on with it."""
    try:
        yield
    except Interrupted as error:
        if count := len(part.receipts):
            shards = "1 shard is" if count == 1 else f"{count} shards are"
            then = (
                "with an object of this session as a policy, a run begins again"
                if live_objects(spec)
                else f"{option} goes on"
            )
            error.left = f"{shards} finished; {then}"
        raise


class _Counted:
    """Moves a bar by the pieces of shards that are made at the same time, in any order."""

    def __init__(self, advance: Advance) -> None:
        self._advance, self._lock = advance, threading.Lock()
        self._rows: dict[int, int] = {}  # by the number of the shard

    def tell(self, number: int, rows: int) -> None:
        """Move the bar to the rows of a shard that are made."""
        with self._lock:
            self._advance(rows - self._rows.get(number, 0))
            self._rows[number] = rows
