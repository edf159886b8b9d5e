"""A shipped set in one line: its environment, and its rows to train and to validate on."""

from __future__ import annotations

import json
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.arguments import public
from ibdata.dataset.reader import Dataset
from ibdata.dataset.selection import Selection
from ibdata.environment import ID
from ibdata.errors import BusyError, DatasetError, UsageError, missing, suggestion
from ibdata.experiment import Experiment, load
from ibdata.experiment.shipped import shipped
from ibdata.generation.generate import generate
from ibdata.numerics.naming import exact
from ibdata.system.cache_folders import cache_folders
from ibdata.system.configs import canonical_file
from ibdata.views.options import View

Arrays = dict[str, npt.NDArray[Any]]
VALIDATION = "validation"
TENTH = 10
PATIENCE = 600.0  # seconds, for another process that makes the dataset


@public
def make(
    name: str,
    *,
    history: int = 1,
    view: View = None,
    seed: int | None = None,
    setpoint: float | None = None,
) -> tuple[Any, Arrays, Arrays]:
    """Make or open a shipped set: `env, train, validation = ibdata.make("siemens-offline/optimized-40")`.

    The dataset is made once, in the folder `datasets` of ibdata's cache, and opened from then on. Needs the
    extra `gymnasium`.

    Args:
        name: A shipped experiment; NAME@566e… refuses a dataset whose content root begins otherwise.
        history: How many observations are stacked, newest first, in the environment and in the arrays.
        view: What is seen and rewarded, as the options of a view (docs/views.md).
        seed: The seed of the dataset, by default that of the experiment, whose content root is known.
        setpoint: The setpoint of the environment, for a set with several. The arrays have all of them.

    Returns:
        The environment of the set, and the rows to train and to validate on, as `Dataset.arrays` has them.
        Those to validate on are the split `validation`, or else the last tenth of those to train on, at
        each setpoint if it has ten or more. Those to train on are the split `train`, or all others.

    Raises:
        UsageError: There is no such set or setpoint, or its content root is another one.
        IbdataError: Gymnasium is not installed.
    """
    set_name, _, expected = name.partition("@")
    experiment = _experiment(set_name, seed)
    environment = _environment(experiment, setpoint, history, view)
    dataset = _dataset(set_name, experiment)
    if not dataset.content_root.startswith(expected):
        raise UsageError(
            f"name: found {name!r}, but the content root of {set_name} is {dataset.content_root}: leave "
            "@… out, or take the version of ibdata that made the other one"
        )
    parts = train_and_validation(dataset)
    train, validation = (part.arrays(history, view=view) for part in parts)
    return environment, train, validation


def train_and_validation(dataset: Dataset) -> tuple[Selection, Selection]:
    """The episodes to train on, and those to validate on."""
    names = set(dataset.splits)
    everything = dataset.select("train" if "train" in names else None)
    if VALIDATION in names:
        validation = dataset.select(VALIDATION)
        return dataset.select(episodes=np.flatnonzero(everything.inside & ~validation.inside)), validation
    numbers = np.flatnonzero(everything.inside)
    cells = dataset.episodes["cell"].to_numpy()[numbers]
    groups = [numbers[cells == cell] for cell in dict.fromkeys(cells)]
    if min(map(len, groups)) < TENTH:
        groups = [numbers]
    last = np.concatenate([group[len(group) - max(1, len(group) // TENTH) :] for group in groups])
    return dataset.select(episodes=np.setdiff1d(numbers, last)), dataset.select(episodes=last)


def _experiment(name: str, seed: int | None) -> Experiment:
    """The shipped experiment of this name."""
    if name not in shipped():
        near = suggestion(name, shipped())
        raise UsageError(f"name: found {name!r}, expected one that ibdata config list prints{near}")
    return load(name, seed=seed)


def _environment(experiment: Experiment, setpoint: float | None, history: int, view: View) -> Any:
    """The environment with the experiment's dynamics, start and steps."""
    points = experiment.scenario.points
    if setpoint is None and len(points) == 1:
        [setpoint] = points
    if setpoint not in points:
        known = ", ".join(map(exact, points))
        raise UsageError(f"setpoint: found {setpoint}, expected one of {known}, for the environment")
    try:
        import gymnasium
    except ModuleNotFoundError:
        raise missing("ibdata.make", "gymnasium", "gymnasium") from None
    return gymnasium.make(
        f"ibdata.environment:{ID}",
        setpoint={"drifting": setpoint} if experiment.scenario.drifting else setpoint,
        dynamics=experiment.dynamics,
        start=experiment.scenario.start_form,
        history=history,
        view=view,
        max_episode_steps=experiment.steps,
    )


def _dataset(name: str, experiment: Experiment) -> Dataset:
    """The dataset in the cache, which is made where it is missing or not what it should be."""
    is_canonical = experiment.seed == load(name).seed
    ending = "" if is_canonical else f"-seed-{experiment.seed}"
    folder = Path(cache_folders().folders[-1], "datasets", name.replace("/", "-") + ending)
    with suppress(DatasetError):
        dataset = Dataset(folder)
        if not is_canonical or dataset.content_root == canonical_root(name):
            return dataset
    dataset = _generated(experiment, folder)
    if is_canonical and dataset.content_root != canonical_root(name):
        raise DatasetError(
            f"{name}: found the content root {dataset.content_root}, expected {canonical_root(name)}; ibdata "
            "is not what it was when its datasets were listed: install it again"
        )
    return dataset


def _generated(experiment: Experiment, folder: Path) -> Dataset:
    """The dataset that this process makes, or that another one has made meanwhile."""
    until = time.monotonic() + PATIENCE
    while True:
        try:
            dataset: Dataset = generate(experiment, folder, overwrite=True)
        except BusyError:
            if time.monotonic() > until:
                raise
            time.sleep(0.1)
        else:
            return dataset


def canonical_root(name: str) -> str:
    """The content root of the dataset of a shipped experiment."""
    root: str = json.loads(canonical_file().read_text(encoding="utf-8"))[name]["content_root"]
    return root
