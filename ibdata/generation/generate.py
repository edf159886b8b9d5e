"""Generating a dataset: plan it, lock the folder, write the missing shards, write the metadata."""

from __future__ import annotations

import os
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.reader import Dataset
from ibdata.experiment import Config, Experiment, Overrides, load, refuse_unreadable
from ibdata.experiment.custom_code import customs, require_consent
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fresh_modules import in_one_folder
from ibdata.experiment.plan import Shard
from ibdata.generation import origin, output_folder, receipt, replacement
from ibdata.generation import upload as uploading
from ibdata.generation.engine import Run, select_engine
from ibdata.generation.make_shard import CountedParts
from ibdata.generation.origin import Origin
from ibdata.generation.staging import discard
from ibdata.system.guard import refusals, writing_to
from ibdata.system.lock import refuse_busy
from ibdata.system.object_store import Remote, url_of
from ibdata.system.progress import bar
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

    Args:
        config: A YAML file, the name of a shipped experiment, a mapping with the keys of such a file, or an
            Experiment. A folder of experiments is for `generate_all`.
        out: The folder of the dataset; by default data/<name>. If it is a URL, such as s3://bucket/name, the
            dataset is made on this machine, then uploaded.
        workers: How many processes to use; by default chosen by the work.
        seed: Replaces the experiment's seed.
        overrides: Replace single values of the experiment: texts `key.sub=value`, or a mapping such as
            {"episodes": 10, "output.shard_rows": 1000}.
        resume: Continue a run that was stopped, or start one. At a URL, upload the files that are missing.
        overwrite: Replace a dataset, which stays complete until the new one is.
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
    if (url := url_of(out)) is not None:
        remote = Remote(url)
        require_consent(DatasetSpec.of(experiment), experiment.name, allow_code)
        folder = uploading.work_folder(remote, experiment)
        found = uploading.find(remote, experiment, folder, resume, overwrite)
        if found.listed is not None:
            origin.refuse_code_other_than(found.listed.code, DatasetSpec.of(experiment), remote.name)
        if not found.finished:
            _generate(experiment, folder, run, True, False, progress, remote.name)
        return uploading.upload(remote, experiment, folder, resume)
    folder = output_folder.resolved(out) if out is not None else default_folder(experiment)
    require_consent(DatasetSpec.of(experiment), experiment.name, allow_code)
    _generate(experiment, folder, run, resume, overwrite, progress)
    return Dataset(folder)


def _generate(
    experiment: Experiment,
    folder: Path,
    run: Run,
    resume: bool,
    overwrite: bool,
    progress: bool | None,
    url: str | None = None,
) -> None:
    """Generate the dataset in a folder, perhaps for a URL; messages about its code name the URL then."""
    where = url or folder
    refuse_busy(folder)
    output_folder.check(folder, experiment, resume, overwrite)
    spec = DatasetSpec.of(experiment)
    with refusals(folder), in_one_folder(spec):
        place = folder.absolute() if customs(spec) else folder  # custom code may change the current folder
        begun = origin.observe(spec, where)  # a signal may end the process, as nothing is written yet
        with writing_to(place, name=folder):
            replacement.finish_interrupted(place)
            root = output_folder.check(place, experiment, resume, overwrite)
            if place == root and (place / manifest.PATH).is_file():
                origin.refuse_other_code(manifest.read(place).code, begun.code, where)
                output_folder.end(place)  # the run was killed after it had finished
            else:
                _run(spec, root, run, overwrite, progress, begun, where)
                if root != place:
                    replacement.commit(place)


def default_folder(experiment: Experiment) -> Path:
    """data/<name> in the current folder."""
    return Path("data") / experiment.name


def _run(
    spec: DatasetSpec,
    root: Path,
    run: Run,
    overwrite: bool,
    progress: bool | None,
    begun: Origin,
    where: Path | str,
) -> None:
    """Write the missing shards into root and finish the dataset. Messages name it `where`."""
    experiment = spec.experiments[0]
    try:
        if overwrite and origin.begun(root) != begun.note():
            discard(root)
        output_folder.begin(root, experiment, overwrite)
        origin.begin(root, begun, where)
        written = make(spec, spec.shards, root, output_folder.identity(experiment), run, progress)
        output_folder.settle_data(root, written)
        finish(spec, written, root, begun.reproducible, begun.code)
    except BaseException:
        output_folder.abandon(root)
        raise
    output_folder.end(root)


def make(
    spec: DatasetSpec, shards: list[Shard], root: Path, identity: str, run: Run, progress: bool | None
) -> list[WrittenShard]:
    """Write the shards that have no receipt yet; return all shards."""
    written = [w for shard in shards if (w := receipt.get(root, identity, spec, shard)) is not None]
    done = {w.shard.number for w in written}
    missing = [shard for shard in shards if shard.number not in done]
    output_folder.forget(root, missing)
    rows = sum((shard.stop - shard.first) * spec.of_shard(shard).steps for shard in shards)
    with bar(progress, rows, "transitions") as advance:
        advance(sum(w.content.moments.rows for w in written))
        counted = CountedParts(advance)
        for w in run(spec, missing, root, identity, counted.tell):
            written.append(w)
            counted.done(w.shard.number, w.content.moments.rows)
    return written
