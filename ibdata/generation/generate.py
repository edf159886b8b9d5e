"""Generating datasets: of an experiment, of each experiment in a folder, or a part of one."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from ibdata.arguments import public
from ibdata.dataset.reader import Dataset
from ibdata.errors import UsageError, notice
from ibdata.experiment import KEYS, Config, Experiment, Overrides, find, load_all
from ibdata.experiment.code import require_consent
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.shipped import is_suite, shipped_name
from ibdata.generation import upload
from ibdata.generation.array_job import Range, make_range
from ibdata.generation.engine import Run, select_engine
from ibdata.generation.run import already_there, make_dataset, refuse_both, settle_left
from ibdata.generation.target import refuse_name
from ibdata.system.part import resolved
from ibdata.system.storage import is_url, local, url_of


@partial(public, keys=KEYS)
def generate(
    config: Config,
    out: str | os.PathLike[str] | None = None,
    *,
    shards: str | None = None,
    workers: int | None = None,
    seed: int | None = None,
    overrides: Overrides = (),
    resume: bool = False,
    overwrite: bool = False,
    progress: bool | None = False,
    allow_code: bool = False,
    engine: str = "local",
    address: str | None = None,
) -> Any:
    """Generate the dataset of an experiment, or of each experiment in a folder, and open it.

    The content depends on the experiment only, not on workers, shards or engine. A dataset of the same
    experiment that is finished already is only opened.

    Args:
        config: A YAML file, the name of a shipped experiment, a mapping with the keys of such a file, an
            Experiment, or a folder of YAML files, all of which are checked before the first is made.
        out: The folder of the dataset, by default data/<name>, or data/<path> of a shipped experiment; the
            datasets of a folder go to out/<file>. If it is a URL, such as s3://bucket/name, the dataset is
            made on this machine, then uploaded.
        shards: "i/n" makes only one of n parts of the files, with i from 1 to n. Any number of hosts that
            share the folder may make parts at the same time; then `finalize` completes the dataset.
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
        The `Dataset`; of a folder, a dict of them by name; of a part, its folder, shards and rows, and how
        many shards are still missing.

    Raises:
        ConfigError: An experiment is not valid.
        UsageError: An argument is invalid, or the folder holds something else.
        BusyError: Another process writes to the folder.
        IbdataError: The system refuses to write, or a worker fails.
    """
    run = select_engine(engine, workers, address)
    refuse_both(resume, overwrite)
    own = None if shards is None else Range.parse(shards)
    experiments, folder = load_all(config, overrides, seed), is_folder(config)
    places = places_of(config, experiments, out)
    elsewhere = resume or own is not None or engine != "local"
    for experiment in experiments:
        require_consent(DatasetSpec.of(experiment), experiment.name, allow_code, again=elsewhere)
    if own is not None:
        if folder or overwrite:
            found = "a folder of experiments" if folder else "--overwrite"
            raise UsageError(f"--shards: found {found} too, but these cannot be combined")
        return make_range(own, experiments[0], places[0], run, progress)
    if not folder:
        return _generate_one(experiments[0], places[0], run, resume, overwrite, progress)
    for experiment, place in zip(experiments, places, strict=True):
        already_there(experiment, resolved(Path(place)), Path(place), resume, overwrite)
    return {
        Path(place).name: _generate_one(experiment, place, run, resume, overwrite, progress)
        for experiment, place in zip(experiments, places, strict=True)
    }


def is_folder(config: Config) -> bool:
    """Whether a config is a folder of experiments."""
    return not isinstance(config, Mapping | Experiment) and is_suite(find(config))


def places_of(
    config: Config, experiments: Sequence[Experiment], out: str | os.PathLike[str] | None
) -> list[Path | str]:
    """The folder or URL of each dataset: by default data/<name>, and data/<its path> for a shipped one.

    Raises UsageError if `out` cannot hold the datasets of a folder.
    """
    if out is not None:
        refuse_name(os.fspath(out).rstrip("/").split("/"), out)
    path = None if isinstance(config, Mapping | Experiment) else find(config)
    if path is None or not is_suite(path):
        if out is not None:
            return [url_of(out) or Path(out)]
        return [Path("data", shipped_name(path) or experiments[0].name)]
    if is_url(out):
        raise UsageError(f"{out}: found a URL for a folder of experiments, expected a folder")
    root = Path("data", path.resolve().name) if out is None else Path(out)
    if os.path.lexists(local(root)) and not local(root).is_dir():
        raise UsageError(f"{root}: is a file, not a folder; choose another --out")
    return [root / file.stem for file in sorted(path.glob("*.yaml"))]


def _generate_one(
    experiment: Experiment, place: Path | str, run: Run, resume: bool, overwrite: bool, progress: bool | None
) -> Dataset:
    if isinstance(place, str):
        work, remote = upload.places(place, experiment)
        if not upload.is_there(remote, experiment, work, resume, overwrite):
            upload.drop_damaged(work)
            make_dataset(experiment, work, Path(remote.name), run, resume, not resume, progress)
            upload.upload(remote, work)
        return Dataset(place)
    target = resolved(place)
    if already_there(experiment, target, place, resume, overwrite):
        settle_left(target)
        notice(f"{place}: already there; nothing was written")
    else:
        make_dataset(experiment, target, place, run, resume, overwrite, progress)
    return Dataset(place)
