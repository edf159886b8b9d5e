"""Datasets made by several hosts: each makes a range of the shards in one part, then one host finishes it.

Ranges share the lock of the part, which keeps out a run that needs it alone. Ranges that have shards in
common make these twice, without harm: each file has a name of its own, and the last receipt counts.
"""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from ibdata.arguments import public
from ibdata.dataset import manifest
from ibdata.dataset.reader import Dataset
from ibdata.errors import UsageError
from ibdata.experiment import Experiment, load
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.generation import origin, receipt
from ibdata.generation.engine import Run
from ibdata.generation.origin import Origin
from ibdata.generation.publish import publish, settle
from ibdata.generation.run import (
    already_there,
    counted_if_stopped,
    drop_others,
    make,
    prepare,
    rows_of,
    unfinished,
)
from ibdata.generation.target import is_free, refuse_incomplete, refuse_taken, size_in
from ibdata.generation.worker import process_for
from ibdata.numerics.naming import counted
from ibdata.system.part import Part, locked_part, resolved
from ibdata.system.storage import refuse_url
from ibdata.writing.finish import finish

MAX_PARTS = 100_000


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
                f"--shards: found {text!r}, expected i/n with i from 1 to n, such as 1/3, 2/3 and 3/3"
            )
        return cls(int(part), int(parts))

    def __str__(self) -> str:
        return f"{self.part}/{self.parts}"

    def of(self, shards: list[Shard]) -> list[Shard]:
        """The consecutive shards of the range. The sizes of ranges differ by at most one shard."""
        n = len(shards)
        return shards[n * (self.part - 1) // self.parts : n * self.part // self.parts]


class PartMade(NamedTuple):
    """A finished range: the dataset's folder, shards and rows, how many shards are missing, and the range."""

    folder: Path
    shards: int
    rows: int
    missing: int
    range: str

    def plain(self) -> dict[str, Any]:
        """The fields as plain data for JSON."""
        fields = self._asdict()
        del fields["folder"], fields["range"]
        return {**fields, "out": str(self.folder), "range": self.range}

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
    own: Range, experiment: Experiment, place: Path | str, run: Run, progress: bool | None
) -> PartMade:
    """Make one part of a dataset's shards; `finalize` finishes the dataset when all parts are made.

    Finished shards are not made again, so the same call continues a part that was stopped.
    """
    if isinstance(place, str):
        raise UsageError(f"{place}: found a URL with --shards, expected a folder that all hosts share")
    target, spec = resolved(place), DatasetSpec.of(experiment)
    mine = own.of(spec.shards)
    if already_there(experiment, target, place, resume=True, overwrite=False):
        return PartMade(place, len(mine), rows_of(spec, mine), 0, str(own))
    with process_for(spec) as process:
        here = process.call(origin.observe)  # compiles for up to a minute, while other hosts need the lock
        with locked_part(target, place, shared=True) as part, counted_if_stopped(part, spec, "--shards"):
            _begin(part, spec, here, place)
            make(process, mine, part, run, progress)
            missing = len(spec.shards) - len(part.receipts)
    return PartMade(place, len(mine), rows_of(spec, mine), missing, str(own))


def _begin(part: Part, spec: DatasetSpec, here: Origin, place: Path) -> None:
    """Begin the run as the first host, or join the one that was begun, and share the part."""
    if part.lock.alone():
        prepare(part, spec, here, place, resume=True)
    part.share()
    other = origin.other(part.folder, spec.experiments[0], here)
    if other is not None:
        raise unfinished(place, other, resume=True)


@public
def finalize(folder: str | os.PathLike[str]) -> Dataset:
    """Complete a dataset whose parts `generate` has made with `shards`: check them, write the manifest.

    No code of a policy is imported, because its hashes were noted when the run began.

    Args:
        folder: The folder of the dataset. A finished dataset is only opened.

    Raises:
        IbdataError: Shards are missing or are not what their receipts say.
        UsageError: No run was begun here.
        BusyError: Parts are still being made.
    """
    refuse_url(folder)
    place, target = Path(folder), resolved(folder)
    if origin.read(Part(target).folder) is None:
        if is_free(target, place):
            raise UsageError(
                f"{place}: holds no finished shard; make all parts with ibdata generate --shards i/n"
            )
        refuse_incomplete(manifest.read(target), partial(size_in, target), place)
        return Dataset(place)
    with locked_part(target, place) as part:
        settle(part)
        begun = origin.read(part.folder)
        if begun is not None:
            _finish(part, begun, place)
    return Dataset(place)


def _finish(part: Part, begun: Origin, place: Path) -> None:
    refuse_taken(part.target, place)
    spec = DatasetSpec.of(load(part.folder / origin.EXPERIMENT))
    todo = "make them with the same command, or with --resume in place of --shards"
    written = receipt.all_of(part.folder, spec.shards, place, todo, receipt.is_whole)
    drop_others(part, written)
    finish(spec, written, part.folder / receipt.DATASET, begun.reproducible, begun.code)
    publish(part)
