"""A shipped set in one line: its environment, and its rows to train and to validate on."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.arguments import public
from ibdata.dataset.reader import Dataset, opened
from ibdata.dataset.selection import Selection
from ibdata.environment import ID
from ibdata.errors import DatasetError, UsageError, missing
from ibdata.experiment import Experiment, load
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.shipped import full_name, shipped
from ibdata.generation.build import is_of
from ibdata.generation.generate import generate
from ibdata.numerics.naming import exact
from ibdata.system.cache_folders import cache_folders
from ibdata.system.configs import canonical_file
from ibdata.system.lock import locked
from ibdata.system.part import refusals
from ibdata.views.options import View

Arrays = dict[str, npt.NDArray[Any]]
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
        Those to validate on are the split `validation`, or else the last tenth of the episodes: at each
        setpoint if all have ten, else of all, which leaves the last setpoints out of the training. Those to
        train on are the split `train` without them, or all others.

    Raises:
        UsageError: There is no such set or setpoint, or its content root is another one.
        IbdataError: Gymnasium is not installed.
    """
    short_name, _, beginning = name.partition("@")
    set_name = full_name("name", short_name, list(shipped()))
    experiment = load(set_name, seed=seed)
    environment = _environment(experiment, setpoint, history, view)
    root = canonical_root(set_name, experiment)
    _refuse_other_content(name, beginning, root)
    dataset = _dataset(set_name, experiment, root)
    _refuse_other_content(name, beginning, dataset.content_root)
    parts = train_and_validation(dataset)
    train, validation = (part.arrays(history, view=view) for part in parts)
    return environment, train, validation


def train_and_validation(dataset: Dataset) -> tuple[Selection, Selection]:
    """The episodes to train on, and those to validate on."""
    everything = dataset.select("train" if "train" in dataset.splits else None)
    if "validation" in dataset.splits:
        validation = dataset.select("validation")
        return dataset.select(episodes=np.flatnonzero(everything.inside & ~validation.inside)), validation
    numbers = np.flatnonzero(everything.inside)
    cells = dataset.episodes["cell"].to_numpy()[numbers]
    groups = [numbers[cells == cell] for cell in dict.fromkeys(cells)]
    if min(map(len, groups)) < TENTH:
        groups = [numbers]
    last = np.concatenate([group[len(group) - max(1, len(group) // TENTH) :] for group in groups])
    return dataset.select(episodes=np.setdiff1d(numbers, last)), dataset.select(episodes=last)


def _refuse_other_content(name: str, beginning: str, root: str | None) -> None:
    """Raise UsageError if the content root is known and does not begin so."""
    if root is not None and not root.startswith(beginning):
        raise UsageError(
            f"name: found {name!r}, but the content root is {root}: leave @… out, or take the seed and the "
            "version of ibdata that made the other one"
        )


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


def _dataset(name: str, experiment: Experiment, root: str | None) -> Dataset:
    """The dataset in the cache, which is made where it is missing or not what it should be."""
    ending = "" if root is not None else f"-seed-{experiment.seed}"
    folder = Path(cache_folders().folders[-1], "datasets", name.replace("/", "-") + ending)
    if dataset := _kept(folder, experiment, root):
        return dataset
    lock = folder.with_name(f".{folder.name}.lock")
    with refusals(folder), locked(lock, PATIENCE, place=folder):
        # Another process may have made it meanwhile.
        dataset = _kept(folder, experiment, root) or opened(generate(experiment, folder, overwrite=True))
    if root not in (None, dataset.content_root):
        raise DatasetError(
            f"{name}: found the content root {dataset.content_root}, expected {root}; ibdata is not what it "
            "was when its datasets were listed: install it again"
        )
    return dataset


def _kept(folder: Path, experiment: Experiment, root: str | None) -> Dataset | None:
    """The dataset in the cache, if it is what it should be."""
    with suppress(DatasetError):
        dataset = Dataset(folder)
        if is_of(dataset.stored.manifest, DatasetSpec.of(experiment)) and root in (
            None,
            dataset.content_root,
        ):
            return dataset
    return None


def canonical_root(name: str, experiment: Experiment) -> str | None:
    """The content root of the dataset of a shipped experiment; None with another seed than its own."""
    if experiment.seed != load(name).seed:
        return None
    root: str = json.loads(canonical_file().read_text(encoding="utf-8"))[name]["content_root"]
    return root
