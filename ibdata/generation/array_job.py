"""Datasets made by several hosts: each makes a range of the shards in one folder, then one host finishes it.

Ranges share the folder's lock, which keeps out a run that needs the whole folder. Each range also has a lock
of its own, so that ranges run at the same time only if they have no shard in common. A range touches no other
range's files.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from ibdata.dataset import manifest
from ibdata.dataset.reader import Dataset
from ibdata.errors import IbdataError, UsageError
from ibdata.experiment import Config, Overrides, load, refuse_unreadable
from ibdata.experiment.custom_code import customs, require_consent
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fresh_modules import in_one_folder
from ibdata.experiment.plan import Shard
from ibdata.generation import origin, output_folder, ranges, receipt
from ibdata.generation.engine import select_engine
from ibdata.generation.generate import default_folder, make
from ibdata.generation.ranges import Range
from ibdata.system.guard import refusals, writing_to
from ibdata.system.lock import refuse_busy, shared
from ibdata.system.object_store import is_url, refuse_url
from ibdata.writing.finish import finish
from ibdata.writing.shard_writer import WrittenShard


class Made(NamedTuple):
    """A finished range: its folder, shards and rows, and how many shards the dataset still lacks."""

    folder: Path
    shards: int
    rows: int
    missing: int


def generate_shards(
    config: Config,
    shards: str,
    out: str | os.PathLike[str] | None = None,
    *,
    workers: int | None = None,
    seed: int | None = None,
    overrides: Overrides = (),
    progress: bool | None = False,
    allow_code: bool = False,
    engine: str = "local",
    address: str | None = None,
) -> Made:
    """Make one part of a dataset's shards; `finalize` finishes the dataset when all parts are made.

    Any number of hosts may make different parts in one folder at the same time. If their file system has
    locks between hosts, a part is refused while another host makes one of its shards. Finished shards are
    not made again, so the same call continues a part that was stopped.

    Args:
        config: As in `generate`.
        shards: "i/n", with i from 1 to n.
        out: The folder that all hosts share; by default data/<name>.
        workers: As in `generate`.
        seed: As in `generate`.
        overrides: As in `generate`.
        progress: As in `generate`.
        allow_code: As in `generate`.
        engine: As in `generate`.
        address: As in `generate`.

    Returns:
        The folder, the shards and rows of the part, and how many shards the dataset still lacks.

    Raises:
        BusyError: Another process makes a part that shares a shard.
        IbdataError: As in `generate`.
    """
    own = Range.parse(shards)
    experiment = load(config, overrides, seed)
    refuse_unreadable(experiment)
    run = select_engine(engine, workers, address)
    if is_url(out):
        raise UsageError(f"{out}: found a URL with --shards, expected a folder that all hosts share")
    folder = output_folder.resolved(out) if out is not None else default_folder(experiment)
    spec = DatasetSpec.of(experiment)
    require_consent(spec, experiment.name, allow_code)
    ranges.refuse_shared(folder, own, spec.shards)
    output_folder.check(folder, experiment, resume=True, overwrite=False)
    with refusals(folder), in_one_folder(spec):
        place = folder.absolute() if customs(spec) else folder  # custom code may change the current folder
        begun = origin.observe(spec, folder)
        with writing_to(place, shared, folder) as leaving, ranges.locked(place, own, spec.shards):
            output_folder.check(place, experiment, resume=True, overwrite=False)
            output_folder.refuse_unsettled(place)
            mine = own.of(spec.shards)
            rows = sum((shard.stop - shard.first) * experiment.steps for shard in mine)
            if manifest.locate(place, manifest.PATH).is_file():
                origin.refuse_other_code(manifest.read(place).code, begun.code, folder)
                return Made(folder, len(mine), rows, 0)
            leaving.callback(output_folder.abandon, place)
            try:
                output_folder.begin_range(place, experiment, mine)
                origin.begin_range(place, begun, folder)
                ranges.note(place, own)
                make(spec, mine, place, output_folder.identity(experiment), run, progress)
            except BaseException:
                output_folder.sweep_shards(place, mine)
                raise
            missing = sum(not (place / receipt.path_of(shard)).is_file() for shard in spec.shards)
    return Made(folder, len(mine), rows, missing)


def finalize(folder: str | os.PathLike[str]) -> Dataset:
    """Finish a dataset whose parts `generate_shards` has made: check every shard and write the manifest.

    No code of a policy is imported, because its hashes were noted when the run began.

    Args:
        folder: The folder of the dataset. A finished dataset is only opened.

    Raises:
        IbdataError: Shards are missing or are not what their receipts say.
        UsageError: No run was begun here, or the record of the run is missing.
        BusyError: Parts are still being made.
    """
    refuse_url(folder)
    path = Path(folder)
    refuse_busy(path)
    if os.path.isdir(path):
        output_folder.refuse_links(path)
    output_folder.refuse_unsettled(path)
    if not os.path.isfile(path / output_folder.EXPERIMENT):
        if os.path.lexists(path / manifest.PATH):
            return Dataset(path)
        raise UsageError(f"{path}: holds no run to finish; begin one with ibdata generate --shards i/n")
    with writing_to(path):
        if not manifest.locate(path, manifest.PATH).is_file():
            _finish(path)
        output_folder.end(path)
    return Dataset(path)


def _finish(folder: Path) -> None:
    experiment = load(folder / output_folder.EXPERIMENT)
    spec, identity = DatasetSpec.of(experiment), output_folder.identity(experiment)
    begun = origin.get(folder, folder)
    written: list[WrittenShard] = []
    missing: list[Shard] = []
    for shard in spec.shards:
        w = receipt.get(folder, identity, spec, shard)
        missing += [shard] if w is None else []
        written += [] if w is None else [w]
    if missing:
        raise IbdataError(_lacking(folder, spec, missing, ranges.noted(folder)))
    try:
        output_folder.settle_data(folder, written)
        finish(spec, written, folder, begun.reproducible, begun.code)
    except BaseException:
        output_folder.abandon(folder)
        raise


def _lacking(folder: Path, spec: DatasetSpec, missing: list[Shard], begun: list[Range]) -> str:
    """A message that names the missing shards and the commands that make them."""
    numbers = [str(shard.number) for shard in missing]
    named = ", ".join(numbers[:8]) + (f" and {len(numbers) - 8} more" if len(numbers) > 8 else "")
    again = f"ibdata generate --config {folder / output_folder.EXPERIMENT} --out {folder} "
    parts = max((own.parts for own in begun), default=0)
    wanted = [own for i in range(parts) if set((own := Range(i + 1, parts)).of(spec.shards)) & set(missing)]
    more = f" (and {', '.join(map(str, wanted[1:4]))}{', …' if wanted[4:] else ''})" if wanted[1:] else ""
    which = f"--shards {wanted[0]}{more}" if wanted else "--resume"
    return (
        f"{folder}: {len(missing)} of {len(spec.shards)} shards are missing: {named}; "
        f"make them with {again}{which}"
    )
