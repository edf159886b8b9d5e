"""Generating the datasets of a folder of experiments, each into a folder of its own."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ibdata.dataset.reader import Dataset
from ibdata.errors import UsageError
from ibdata.experiment import Config, Experiment, Overrides, find, load_all
from ibdata.experiment.custom_code import require_consent
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.shipped import is_suite
from ibdata.generation.engine import select_engine
from ibdata.generation.estimate import preview
from ibdata.generation.generate import already_there, generate
from ibdata.system.part import resolved
from ibdata.system.storage import is_url


def generate_all(
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
) -> dict[str, Dataset]:
    """Generate the datasets of a folder of experiments, or of a shipped suite.

    All experiments and all places are checked before the first dataset is made.

    Args:
        config: A folder of YAML files, the name of a shipped suite, or a single experiment as in `generate`.
        out: The datasets go to out/<name>; by default out is data/<folder>, or data for a single experiment.
        workers: As in `generate`.
        seed: Replaces the seed of each experiment.
        overrides: Replace single values of each experiment, as in `generate`.
        resume: Continue runs that were stopped; datasets that are finished are skipped in any case.
        overwrite: Replace datasets; each stays complete until the new one is.
        progress: As in `generate`.
        allow_code: As in `generate`.
        engine: As in `generate`.
        address: As in `generate`.

    Returns:
        The datasets by name.

    Raises:
        IbdataError: As in `generate`.
    """
    experiments = load_all(config, overrides, seed)
    select_engine(engine, workers, address)
    places = folders(config, experiments, out)
    for experiment, folder in zip(experiments, places, strict=True):
        require_consent(DatasetSpec.of(experiment), experiment.name, allow_code)
        already_there(experiment, resolved(folder), folder, resume, overwrite)
    return {
        experiment.name: generate(
            experiment,
            folder,
            workers=workers,
            resume=resume,
            overwrite=overwrite,
            progress=progress,
            allow_code=allow_code,
            engine=engine,
            address=address,
        )
        for experiment, folder in zip(experiments, places, strict=True)
    }


def preview_all(
    config: Config,
    out: str | os.PathLike[str] | None = None,
    *,
    workers: int | None = None,
    seed: int | None = None,
    overrides: Overrides = (),
    resume: bool = False,
    overwrite: bool = False,
    allow_code: bool = False,
) -> list[dict[str, Any]]:
    """Preview each run of `generate_all`, as `preview` does; each result also has its name."""
    experiments = load_all(config, overrides, seed)
    return [
        {"name": experiment.name, **preview(experiment, folder, workers, resume, overwrite, allow_code)}
        for experiment, folder in zip(experiments, folders(config, experiments, out), strict=True)
    ]


def folders(
    config: Config, experiments: Sequence[Experiment], out: str | os.PathLike[str] | None
) -> list[Path]:
    """The folders of the datasets. Raises UsageError if out is a file or a URL."""
    if is_url(out):
        raise UsageError(f"{out}: found a URL for a folder of experiments, expected a folder")
    if out is not None:
        root = Path(out)
    elif isinstance(config, Mapping | Experiment) or not is_suite(find(config)):
        root = Path("data")
    else:
        root = Path("data") / find(config).resolve().name
    if os.path.lexists(root) and not root.is_dir():
        raise UsageError(f"{root}: is a file, not a folder; choose another --out")
    return [root / experiment.name for experiment in experiments]
