"""Generating a dataset: lock its part, make the missing shards, write the metadata, publish it."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ibdata.dataset.reader import Dataset
from ibdata.errors import IbdataError, Interrupted, UsageError, printable
from ibdata.experiment import Config, Experiment, Overrides, load, refuse_unreadable
from ibdata.experiment.code_comparison import listed as names_of
from ibdata.experiment.custom_code import require_consent
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fresh_modules import in_one_folder
from ibdata.experiment.plan import Shard
from ibdata.generation import origin, receipt, upload
from ibdata.generation.engine import Run, select_engine
from ibdata.generation.origin import Origin
from ibdata.generation.publish import publish, settle
from ibdata.generation.target import TakenError, present, refuse_immovable
from ibdata.system.part import Part, locked_part, resolved
from ibdata.system.progress import Advance, bar
from ibdata.system.storage import url_of
from ibdata.writing.finish import finish
from ibdata.writing.shard_writer import WrittenShard


def generate(
    config: Config,
    out: str | os.PathLike[str] | None = None,
    *,
    workers: int | None = None,
    seed: int | None = None,
    overrides: Overrides = (),
    resume: bool = False,
    overwrite: bool = False,
    progress: bool | None = False,
    allow_code: bool = False,
    engine: str = "local",
    address: str | None = None,
) -> Dataset:
    """Generate the dataset of an experiment and open it. The content does not depend on workers or engine.

    A dataset of the same experiment that is finished already is only opened.

    Args:
        config: A YAML file, the name of a shipped experiment, a mapping with the keys of such a file, or an
            Experiment. A folder of experiments is for `generate_all`.
        out: The folder of the dataset; by default data/<name>. If it is a URL, such as s3://bucket/name, the
            dataset is made on this machine, then uploaded.
        workers: How many processes to use; by default chosen by the work.
        seed: Replaces the experiment's seed.
        overrides: Replace single values of the experiment: texts `key.sub=value`, or a mapping such as
            {"episodes": 10, "output.shard_rows": 1000}.
        resume: Continue a run that was stopped, or start one.
        overwrite: Replace a dataset, which stays complete until the new one is. A run that was stopped is
            continued if it is this experiment's, and discarded otherwise.
        progress: Whether to show a bar on stderr; None shows it if stderr is a terminal.
        allow_code: Allow custom policies, which run arbitrary Python code. Use only with code you trust. They
            give the same bits only in the same environment, and a run resumes only with the same code.
        engine: "local", or "ray" to run the shards on Ray.
        address: The address of Ray; by default Ray is started on this machine.

    Returns:
        The finished dataset.

    Raises:
        ConfigError: The experiment is not valid.
        UsageError: An argument is invalid, or the folder holds something else.
        BusyError: Another process writes to the folder.
        IbdataError: The system refuses to write, or a worker fails.
    """
    experiment = load(config, overrides, seed)
    refuse_unreadable(experiment)
    run = select_engine(engine, workers, address)
    if resume and overwrite:
        raise UsageError("--resume and --overwrite exclude each other; give one of them")
    require_consent(DatasetSpec.of(experiment), experiment.name, allow_code)
    if (url := url_of(out)) is not None:
        work, remote = upload.places(url, experiment)
        if not upload.is_there(remote, experiment, work, resume, overwrite):
            make_dataset(experiment, work, Path(remote.name), run, resume, not resume, progress)
            upload.upload(remote, work)
        return Dataset(url)
    place = default_folder(experiment) if out is None else Path(out)
    target = resolved(place)
    if already_there(experiment, target, place, resume, overwrite):
        _settle_left(target)
        told = f"ibdata: {place}: already there; nothing was written"
        print(printable(told), file=sys.stderr, flush=True)
    else:
        make_dataset(experiment, target, place, run, resume, overwrite, progress)
    return Dataset(place)


def default_folder(experiment: Experiment) -> Path:
    """data/<name> in the current folder."""
    return Path("data") / experiment.name


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
    option = "--overwrite" if overwrite else "--resume"
    with in_one_folder(spec):
        here = origin.observe(spec, place)  # a signal may end the process, since nothing is written yet
        with locked_part(target, place) as part, counted_if_stopped(part, option):
            settle(part)
            if already_there(experiment, target, place, resume, overwrite):
                return
            refuse_immovable(part, place)
            prepare(part, spec, here, place, resume, overwrite)
            make(spec, spec.shards, part, run, progress)
            written = finished(spec, part)
            finish(spec, written, part.folder / receipt.DATASET, here.reproducible, here.code)
            present(target, place, experiment, overwrite)  # somebody may have put files there meanwhile
            publish(part)


def already_there(experiment: Experiment, target: Path, place: Path, resume: bool, overwrite: bool) -> bool:
    """Whether the dataset is finished. Raises UsageError if another one may not be replaced.

    Other code of its policies is an error, and with `resume` a warning, since nothing would run.
    """
    listed = present(target, place, experiment, overwrite)
    if listed is None:
        return False
    changed = origin.changed_code(listed.code, origin.code_here(DatasetSpec.of(experiment)))
    if changed and not resume:
        raise TakenError(
            f"{place}: holds the dataset of this experiment with other code, in {names_of(changed)}; "
            "--overwrite to make it again"
        )
    if changed:
        found = f"ibdata: {place}: was made with other code than is here, in {names_of(changed)}"
        print(printable(found), file=sys.stderr, flush=True)
    return True


def _settle_left(target: Path) -> None:
    """Remove the part of a dataset that is there, if its run was killed after it had published it."""
    part = Part(target)
    if part.folder.exists() and origin.is_published(part.folder):
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
        told = f"ibdata: {place}: the unfinished run {other} that was begun here is discarded"
        print(printable(told), file=sys.stderr, flush=True)
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


def make(spec: DatasetSpec, shards: list[Shard], part: Part, run: Run, progress: bool | None) -> None:
    """Make the shards of which the part has no receipt, or whose files are not as their receipts say."""
    missing, done = [], 0
    for shard in shards:
        written = receipt.get(part.folder, shard)
        if written is None or not receipt.is_whole(part.folder, written):
            missing.append(shard)
        else:
            done += rows_of(spec, [shard])
    with bar(progress, rows_of(spec, shards), "transitions") as advance:
        advance(done)
        counted = _Counted(advance)
        for number in run(spec, missing, part.folder, counted.tell):
            counted.tell(number, rows_of(spec, [spec.shards[number]]))


def rows_of(spec: DatasetSpec, shards: list[Shard]) -> int:
    """The number of rows of shards."""
    return sum((shard.stop - shard.first) * spec.of_shard(shard).steps for shard in shards)


def finished(spec: DatasetSpec, part: Part) -> list[WrittenShard]:
    """The shards that are finished in a part, from their receipts; all other files in `data` go."""
    found = [receipt.get(part.folder, shard) for shard in spec.shards]
    written = [each for each in found if each is not None]
    known = {each.entry.path for each in written}
    for path in (part.folder / receipt.DATASET / "data").iterdir():
        if f"data/{path.name}" not in known:
            path.unlink()
    return written


@contextmanager
def counted_if_stopped(part: Part, option: str) -> Iterator[None]:
    """Let a signal's exception say what is left behind; `option` is the one that goes on with it."""
    try:
        yield
    except Interrupted as error:
        if count := len(part.receipts):
            shards = "1 shard is" if count == 1 else f"{count} shards are"
            error.left = f"{shards} finished; {option} goes on"
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
