"""Splitting a finished dataset: labels on its episodes, or a copy whose splits are whole files."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from ibdata.dataset.reader import Dataset
from ibdata.errors import UsageError
from ibdata.experiment import split_schemes
from ibdata.experiment.dataset_spec import DatasetSpec, spec_in
from ibdata.experiment.scalars import SplitName
from ibdata.maintenance.rewrite import relabel, sources_of, write_dataset

SCHEMES = ("transfer", "leave-one-out", "interpolation", "extrapolation", "distance")


def split(
    folder: str | os.PathLike[str] | Dataset,
    by: str | None = "setpoint",
    *,
    scheme: str = "transfer",
    source: Sequence[float] = (),
    target: Sequence[float] = (),
    shots: int | None = None,
    transitions: int | None = None,
    within: float | None = None,
    fractions: Sequence[float] = (0.8, 0.1, 0.1),
    materialize: str | os.PathLike[str] | None = None,
) -> Dataset:
    """Split a dataset by setpoint, episode or policy, and open it.

    The splits are labels on episodes: nothing is copied and no row changes. A split with the same name that
    was made in this way before is replaced.

    Args:
        folder: A dataset, or its folder.
        by: What decides the split of an episode: "setpoint", by scheme; "episode", into fractions; "policy",
            one split per label. None keeps the splits of the dataset, and needs materialize.
        scheme: How setpoints are split:
            transfer: source and target; the episodes of a target cell beyond shots or transitions are
                target-rest
            leave-one-out: train-p and test-p for every setpoint p
            interpolation, extrapolation: train and test, with inner or with the outermost setpoints held out
            distance: source, and the other setpoints as near and far
        source: The setpoints of the split source, for transfer and distance.
        target: The setpoints of the split target, for transfer.
        shots: The largest number of episodes from each target cell, for transfer.
        transitions: The largest number of rows from each target cell, for transfer.
        within: The largest distance of a near setpoint from a source setpoint, for distance.
        fractions: The shares of every cell for train, validation and test, or for train and test.
        materialize: The folder for a copy with the same content root, in which every split consists of whole
            files; the dataset itself does not change.

    Returns:
        The dataset, or the copy.

    Raises:
        UsageError: An argument is invalid.
        DatasetError: The dataset is damaged.
    """
    dataset = folder if isinstance(folder, Dataset) else Dataset(folder)
    spec = spec_in(dataset.path, dataset.manifest_model)
    made: dict[str | None, Callable[[], split_schemes.Splits]] = {
        "setpoint": lambda: _by_setpoint(spec, scheme, source, target, shots, transitions, within),
        "episode": lambda: split_schemes.by_episode(spec, fractions),
        "policy": lambda: split_schemes.by_policy(spec),
    }
    if by not in made and (by is not None or materialize is None):
        found = "nothing" if by is None else repr(by)
        raise UsageError(f"split: found {found}, expected by setpoint, episode or policy")
    new = made[by]() if by in made else {}
    _refuse_names(dataset, spec, new)
    labelled = DatasetSpec(spec.name, spec.experiments, {**spec.later, **new})
    if materialize is None:
        return relabel(dataset, labelled)
    return write_dataset(labelled.all_declared(), sources_of(dataset, spec), Path(materialize))


def _by_setpoint(
    spec: DatasetSpec,
    scheme: str,
    source: Sequence[float],
    target: Sequence[float],
    shots: int | None,
    transitions: int | None,
    within: float | None,
) -> split_schemes.Splits:
    if scheme == "transfer":
        return split_schemes.transfer(spec, source, target, shots, transitions)
    if scheme == "leave-one-out":
        return split_schemes.leave_one_out(spec)
    if scheme in ("interpolation", "extrapolation"):
        return split_schemes.held_out(spec, extrapolate=scheme == "extrapolation")
    if scheme == "distance" and source and within is not None:
        return split_schemes.by_distance(spec, source, within)
    if scheme == "distance":
        raise UsageError("split: the scheme distance needs both --source and --within")
    raise UsageError(f"split: found the scheme {scheme!r}, expected one of {', '.join(SCHEMES)}")


def _refuse_names(dataset: Dataset, spec: DatasetSpec, new: split_schemes.Splits) -> None:
    declared, valid = set(spec.declared), TypeAdapter(SplitName)
    for name in new:
        if name in declared:
            raise UsageError(
                f"{dataset.path}: {name} is a declared split, which has files of its own; choose another name"
            )
        try:
            valid.validate_python(name)
        except ValidationError:
            raise UsageError(f"split: found the name {name!r}, expected one that may name a file") from None
