"""Generating datasets: of an experiment, of each experiment in a folder, or a part of one.

Several hosts can make a range of the shards each in one part, then one host finalizes it. In a folder, ranges
share the lock of the part, which keeps out a run that needs it alone. Ranges that have shards in common make
these twice, without harm: both make the same file.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from ibdata._numerics.arguments import public
from ibdata._numerics.naming import counted
from ibdata._system.progress import Progress
from ibdata._system.storage import is_url, local, url_of
from ibdata.dataset import manifest
from ibdata.dataset.dataset import Dataset
from ibdata.errors import OUT, OVERWRITE, SHARDS, UsageError, notice, public_url
from ibdata.experiment import KEYS, Config, Overrides, load_all, shipped
from ibdata.generation.build import Build
from ibdata.generation.place import place_at, refuse_damage
from ibdata.generation.process import Process, process_for
from ibdata.generation.record import observe
from ibdata.generation.small_work import interpret_few_rows
from ibdata.generation.workers import Engine, select_engine
from ibdata.plan.consent import require_consent
from ibdata.plan.dataset_spec import DatasetSpec, Shard

MAX_PARTS = 100_000


@partial(public, keys=KEYS)
def generate(
    config: Config,
    out: str | os.PathLike[str] | None = None,
    *,
    shards: str | None = None,
    workers: int | None = None,
    seed: int | None = None,
    overrides: Overrides = (),
    overwrite: bool = False,
    progress: bool | None = False,
    allow_code: bool = False,
    engine: str = "local",
    address: str | None = None,
) -> Any:
    """Generate the dataset of an experiment, or of each experiment in a folder, and open it.

    The content depends on the experiment only, not on workers, shards or engine. A dataset of the same
    experiment that is finished already is only opened. The same call goes on with a run that was stopped.

    Args:
        config: A YAML file, the name of a shipped experiment, a mapping with the keys of such a file, an
            Experiment, or a folder of YAML files, all of which are checked before the first is made.
        out: The folder of the dataset, by default data/<name>, or data/<path> of a shipped experiment; the
            datasets of a folder go to out/<file>. If it is a URL, such as s3://bucket/name, each shard goes
            there as soon as it is made.
        shards: "i/n" makes only one of n parts of the files, with i from 1 to n. Any number of hosts that
            share the folder or the URL may make parts at the same time; then `finalize` completes the
            dataset.
        workers: How many processes to use; by default chosen by the work.
        seed: Replaces the experiment's seed.
        overrides: Replace single values of the experiment: texts `key.sub=value`, or a mapping such as
            {"episodes": 10, "output.shard_rows": 1000}.
        overwrite: Replace a dataset in a folder, which stays complete until the new one is. An unfinished run
            of another experiment, or of other code, is dropped at once.
        progress: Whether to show a bar on stderr; None shows it if stderr is a terminal.
        allow_code: Allow custom policies, which run arbitrary Python code. Use only with code you trust. They
            give the same bits only in the same environment, and a run goes on only with the same code.
        engine: "local", or "ray" to run the shards on Ray.
        address: The address of Ray; by default Ray is started on this machine.

    Returns:
        The `Dataset`; of a folder, a dict of them by name; of a part, its folder, shards and rows, and how
        many shards are still missing.

    Raises:
        ConfigError: An experiment is not valid.
        UsageError: An argument is invalid, or the folder holds something else.
        BusyError: Another process writes to the folder.
        IbdataError: The system refuses to write, or a worker fails.
    """
    chosen = select_engine(engine, workers, address)
    shard_range = None if shards is None else Range.parse(shards)
    folder, files, experiments = load_all(config, overrides, seed)
    specs = [DatasetSpec.of(experiment) for experiment in experiments]
    places = places_of(folder, files, specs, out)
    elsewhere = shard_range is not None or engine != "local"
    for spec in specs:
        require_consent(spec, spec.name, allow_code, again=elsewhere)
    interpret_few_rows(specs, places)
    if shard_range is not None:
        if folder or overwrite:
            problem = "a folder of experiments" if folder else OVERWRITE
            raise UsageError(f"{SHARDS}: found {problem} too, but these cannot be combined")
        return make_range(shard_range, specs[0], places[0], chosen, Progress(progress))
    if not folder:
        return _generate_one(specs[0], places[0], chosen, overwrite, Progress(progress))
    for spec, place in zip(specs, places, strict=True):
        Build(place, spec, overwrite=overwrite).look(tidy=True)
    return {
        Path(place).name: _generate_one(spec, place, chosen, overwrite, Progress(progress))
        for spec, place in zip(specs, places, strict=True)
    }


def places_of(
    folder: Path | None,
    files: Sequence[Path],
    specs: Sequence[DatasetSpec],
    out: str | os.PathLike[str] | None,
) -> list[Path | str]:
    """The folder or URL of each dataset of a file or folder: by default data/<name>, or data/<shipped path>.

    Raises UsageError if `out` cannot hold the datasets of a folder.
    """
    if out is not None:
        manifest.refuse_name(os.fspath(out).rstrip("/").split("/"), out)
    if folder is None:
        if out is not None:
            return [url_of(out) or Path(out)]
        names = [name for name, file in shipped().items() if file in files]
        return [Path("data", *names or [specs[0].name])]
    if is_url(out):
        raise UsageError(f"{out}: found a URL for a folder of experiments, expected a folder")
    root = Path("data", folder.resolve().name) if out is None else Path(out)
    if os.path.lexists(local(root)) and not local(root).is_dir():
        raise UsageError(f"{root}: is a file, not a folder; choose another {OUT}")
    return [root / file.stem for file in files]


def _generate_one(
    spec: DatasetSpec, place: Path | str, engine: Engine, overwrite: bool, progress: Progress
) -> Dataset:
    build = Build(place, spec, overwrite=overwrite)
    if build.look(tidy=True):
        notice(f"{build.name}: already there; nothing was written")
        return Dataset(place)
    with process_for(spec) as process:
        record = process.call(observe)  # a signal may end the process: nothing is written yet
        with build.open(record):
            _make_shards(build, spec.shards, process, engine, progress)
            build.publish()
    return Dataset(place)


def _make_shards(
    build: Build, shards: list[Shard], process: Process, engine: Engine, progress: Progress
) -> None:
    """Make those of the shards that are missing."""
    spec, missing = build.spec, build.missing(shards)
    if not missing:
        return
    rows = spec.rows_in(shards)
    with progress.bar(rows, rows - spec.rows_in(missing)):
        for number in engine(process, missing, build.run, progress.reach):
            progress.reach(number, spec.rows_in([spec.shards[number]]))


class Range(NamedTuple):
    """One of several equal parts of a dataset's shards, counted from 1."""

    part: int
    parts: int

    @classmethod
    def parse(cls, text: str) -> Range:
        """Parse `i/n`. Raises UsageError for anything else."""
        part, slash, parts = str(text).partition("/")
        whole = slash and all(x.isascii() and x.isdigit() and len(x) < 10 for x in (part, parts))
        if not whole or not 1 <= int(part) <= int(parts) <= MAX_PARTS:
            raise UsageError(
                f"{SHARDS}: found {text!r}, expected i/n with i from 1 to n, such as 1/3, 2/3 and 3/3"
            )
        return cls(int(part), int(parts))

    def __str__(self) -> str:
        return f"{self.part}/{self.parts}"

    def of(self, shards: list[Shard]) -> list[Shard]:
        """The consecutive shards of the range. The sizes of ranges differ by at most one shard."""
        n = len(shards)
        return shards[n * (self.part - 1) // self.parts : n * self.part // self.parts]


class PartMade(NamedTuple):
    """What `generate` returns of one part of an array job.

    Attributes:
        folder: the folder of the dataset, or its URL.
        shards: the number of files of this part.
        rows: the number of their rows.
        missing: how many files of the whole dataset are missing.
        range: the part, such as "1/2".
    """

    folder: Path | str
    shards: int
    rows: int
    missing: int
    range: str

    def plain(self) -> dict[str, Any]:
        """The fields as plain data for JSON."""
        counts = {"shards": self.shards, "rows": self.rows, "missing": self.missing}
        return {**counts, "out": str(self.folder), "range": self.range}

    def __repr__(self) -> str:
        left = "all shards are complete"
        if self.missing:
            left = f"shards that are still missing: {self.missing:,}; when all are complete"
        lines = [
            f"{self.folder}: part {self.range} is complete: {counted(self.shards, 'shard')} with "
            f"{counted(self.rows, 'row')}",
            f"{left}, run ibdata finalize {self.folder}",
        ]
        if not self.shards:
            lines.append("there are fewer shards than parts; a smaller output.shard_rows makes more")
        return "\n".join(lines)


def make_range(
    shard_range: Range, spec: DatasetSpec, place: Path | str, engine: Engine, progress: Progress
) -> PartMade:
    """Make one part of a dataset's shards; `finalize` finishes the dataset when all parts are made.

    Finished shards are not made again, so the same call continues a part that was stopped.
    """
    shards, missing = shard_range.of(spec.shards), 0
    build = Build(place, spec, replaces=f"{OVERWRITE} without {SHARDS}")
    if not build.look(tidy=True):
        with process_for(spec) as process:
            record = process.call(observe)  # for up to a minute, while other hosts need the lock
            with build.open(record, shared=True):
                _make_shards(build, shards, process, engine, progress)
                missing = 0 if build.is_published() else len(spec.shards) - build.finished
    shown = public_url(place) if isinstance(place, str) else place
    return PartMade(shown, len(shards), spec.rows_in(shards), missing, str(shard_range))


@public
def finalize(folder: str | os.PathLike[str]) -> Dataset:
    """Complete a dataset whose parts `generate` has made with `shards`: check them, write the manifest.

    No code of a policy is imported, because its hashes were noted when the run began.

    Args:
        folder: The folder of the dataset, or its URL. A finished dataset is only opened.

    Raises:
        IbdataError: Shards are missing or are not what their receipts say.
        UsageError: No run was begun here.
        BusyError: Parts are still being made.
    """
    place = place_at(folder)
    place.tidy()
    place.refuse(overwrite=False)
    if place.found() is None:
        begun = Build.begun(folder)
        if begun is None and place.found() is None:  # which another host may have published meanwhile
            raise UsageError(
                f"{place.name}: holds no finished shard; make all parts with ibdata generate --shards i/n"
            )
        if begun is not None:
            build, record = begun
            with build.open(record):
                build.publish(closely=True)
    dataset = Dataset(folder)
    place.found()
    refuse_damage(dataset.stored.manifest, place)
    return dataset
