"""A shipped set in one line: its environment, and its rows to train and to validate on."""

from __future__ import annotations

import json
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arguments import public
from ibdata._numerics.arrays import Arrays
from ibdata._numerics.naming import exact
from ibdata._system.cache_folders import cache_folders
from ibdata._system.configs import canonical_file
from ibdata._system.files import remove
from ibdata._system.lock import locked
from ibdata._system.part import refusing_system_errors
from ibdata.dataset.dataset import Dataset, opened
from ibdata.environment import ID
from ibdata.errors import BusyError, DatasetError, UsageError, missing, notice
from ibdata.experiment import Experiment, load, shipped
from ibdata.experiment.catalogue import full_name
from ibdata.generation.generate import generate
from ibdata.plan.dataset_spec import DatasetSpec
from ibdata.tools.validate import validate
from ibdata.views.options import View

if TYPE_CHECKING:
    import pandas as pd

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
        view: What is seen and rewarded, as the options of a view (the page "Views and costs").
        seed: The seed of the dataset, by default that of the experiment, whose content root is known.
        setpoint: The setpoint of the environment alone, for a set with several. A line on stderr says at
            which setpoints the rows are.

    Returns:
        The environment of the set, and the rows to train and to validate on, as `Dataset.arrays` has them.
        They have no episode of the split `test`, nor one outside of `train` if there is that split. Those to
        validate on are the split `validation`, or else the last tenth of the episodes, at least one, of each
        policy at each setpoint that has several; where all have one, of all, which are the last setpoints.

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
    if len(experiment.scenario.points) > 1:
        at = [_range(part.episode_table["setpoint"].to_numpy()) for part in parts]
        notice(f"{set_name}: trains at {at[0]}, validates at {at[1]}; setpoint= is the environment's alone")
    train, validation = (part.arrays(history, view=view) for part in parts)
    return environment, train, validation


def train_and_validation(dataset: Dataset) -> tuple[Dataset, Dataset]:
    """The episodes to train on, and those to validate on; those of the split `test` are neither."""
    episodes = dataset.episodes
    splits = {name: dataset.select(name).inside for name in dataset.splits}
    usable = ~splits.get("test", np.zeros(len(episodes), np.bool_))
    train = usable & splits.get("train", usable)
    last = np.isin(episodes["episode"], _last_tenths(episodes[train]))
    validation = usable & splits.get("validation", last)
    return (
        dataset.select(episodes=np.flatnonzero(train & ~validation)),
        dataset.select(episodes=np.flatnonzero(validation)),
    )


def _last_tenths(episodes: pd.DataFrame) -> list[int]:
    """The last tenth of the episodes of each cell; of each setpoint whose cells have one; or of all."""
    groups = []
    for _, here in episodes.groupby("setpoint"):
        cells = [cell for _, cell in here.groupby("cell", observed=True) if len(cell) > 1]
        groups += cells or [here] * (len(here) > 1)
    last = (group["episode"].tolist()[-max(1, len(group) // TENTH) :] for group in groups or [episodes])
    return list(chain.from_iterable(last))


def _range(setpoints: npt.NDArray[np.float64]) -> str:
    """The lowest and the highest setpoint, or the only one."""
    return " … ".join(dict.fromkeys([exact(setpoints.min()), exact(setpoints.max())]))


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
    """The dataset in the cache, which is ibdata's own: where it is not what it should be it is made again."""
    ending = "" if root is not None else f"-seed-{experiment.seed}"
    folder = Path(cache_folders().folders[-1], "datasets", name.replace("/", "-") + ending)
    if dataset := _kept(folder, experiment, root):
        return dataset
    lock = folder.with_name(f".{folder.name}.lock")
    with refusing_system_errors(folder), locked(lock, PATIENCE, place=folder):
        kept = _kept(folder, experiment, root)  # another process may have made it meanwhile
        if kept is None:
            remove(folder)
        dataset = kept or opened(generate(experiment, folder, overwrite=True))
    if root not in (None, dataset.content_root):
        raise DatasetError(
            f"{name}: found the content root {dataset.content_root}, expected {root}; ibdata is not what it "
            "was when its datasets were listed: install it again"
        )
    return dataset


def _kept(folder: Path, experiment: Experiment, root: str | None) -> Dataset | None:
    """The dataset in the cache, if it is what it should be, and whole."""
    with suppress(DatasetError, BusyError):
        dataset = Dataset(folder)
        listed = dataset.stored.manifest
        difference = DatasetSpec.of(experiment).difference(listed.name, listed.experiments)
        if difference is None and root in (None, dataset.content_root) and not validate(dataset, quick=True):
            return dataset
    return None


def canonical_root(name: str, experiment: Experiment) -> str | None:
    """The content root of the dataset of a shipped experiment; None with another seed than its own."""
    if experiment.seed != load(name).seed:
        return None
    root: str = json.loads(canonical_file().read_text(encoding="utf-8"))[name]["content_root"]
    return root
