"""Splitting a finished dataset: labels on its episodes, or a copy whose splits are whole files."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from ibdata._numerics.arguments import public
from ibdata.dataset.dataset import Dataset, Place, to_write
from ibdata.errors import UsageError, meant, parameter
from ibdata.experiment import split_schemes
from ibdata.experiment.dataset_spec import DatasetSpec, spec_in
from ibdata.experiment.fields import SplitName
from ibdata.experiment.split_schemes import Splits
from ibdata.tools.rewrite import relabel, write_dataset
from ibdata.tools.split_options import DEFAULT_SCHEME, OPTIONS, SCHEMES, refuse_unused


@public
def split(
    folder: Place,
    by: str | None = None,
    *,
    scheme: str | None = None,
    source: float | Sequence[float] = (),
    target: float | Sequence[float] = (),
    shots: int | None = None,
    transitions: int | None = None,
    within: float | None = None,
    fractions: Sequence[float] | None = None,
    prefix: str | None = None,
    names: Mapping[str, str] | None = None,
    remove: str | Sequence[str] = (),
    materialize: str | os.PathLike[str] | None = None,
) -> Dataset:
    """Split a dataset by setpoint, episode or policy, and open it.

    The splits are labels on episodes: nothing is copied and no row changes. A split with the same name that
    was made in this way before is replaced; give names or a prefix to keep both. Earlier splits that were
    made together with those, such as a target-rest that is not made anew, are removed.

    Args:
        folder: A dataset, or its folder.
        by: The property that decides the split of an episode: "setpoint", by scheme; "episode", into
            fractions; "policy", one split per label. Without it, no split is made, and remove or materialize
            is needed.
        scheme: How setpoints are split, by default transfer:
            transfer: source and target; the episodes of a target cell beyond shots or transitions are
                target-rest
            leave-one-out: train-p and test-p for every setpoint p
            interpolation, extrapolation: train and test, with inner or with the outermost setpoints held out
            distance: source, and the other setpoints as near and far
        source: The setpoint or setpoints of the split source, for transfer and distance.
        target: The setpoint or setpoints of the split target, for transfer.
        shots: The largest number of episodes from each target cell, for transfer.
        transitions: The largest number of rows from each target cell, for transfer.
        within: The largest distance of a near setpoint from a source setpoint, for distance.
        fractions: The shares of every cell for train, validation and test, or for train and test; by default
            0.8, 0.1, 0.1.
        prefix: The new splits are named prefix-source, prefix-target, …
        names: Names for single new splits in place of those above, such as {"source": "at-50"}.
        remove: The name or names of splits to remove. A declared split has files of its own and stays.
        materialize: The folder for a copy with the same content root, in which every split consists of whole
            files; the dataset itself does not change.

    Returns:
        The dataset, or the copy.

    Raises:
        UsageError: An argument is invalid, or is one that the scheme does not use.
        DatasetError: The dataset is damaged.
    """
    dataset = to_write(folder)
    spec = spec_in(dataset.stored)
    remove = [remove] if isinstance(remove, str) else remove
    points = {"source": _several(source), "target": _several(target)}
    options: dict[str, Any] = {"scheme": scheme, **points, "shots": shots}
    options |= {"transitions": transitions, "within": within}
    options["fractions"] = _several(() if fractions is None else fractions)
    chosen = {
        name: x for name, x in options.items() if x is not None and not (isinstance(x, Sequence) and not x)
    }
    if by not in OPTIONS and (by is not None or chosen or not (remove or materialize)):
        found = "nothing" if by is None else repr(by)
        properties = f"{parameter('by')} setpoint, episode or policy"
        raise UsageError(f"split: found {found}, expected a property: {properties}")
    splits = _made(spec, by, chosen) if by else {}
    new = _named(splits, prefix, names or {})
    _refuse_names(dataset, spec, new)
    _refuse_removal(dataset, spec, remove)
    gone = {*remove, *(_prefixed(name, prefix) for name in _made_together(splits, names or {}))}
    later = {name: split for name, split in spec.later.items() if name not in gone}
    labelled = DatasetSpec(spec.name, spec.experiments, {**later, **new})
    if materialize is None:
        return relabel(dataset, spec, labelled)
    return write_dataset(labelled.all_declared(), dataset, materialize)


def _several(numbers: float | Sequence[float]) -> list[float]:
    several: list[float] = np.ravel(numbers).tolist()
    return several


def _made(spec: DatasetSpec, by: str, given: dict[str, Any]) -> Splits:
    """The splits that a scheme makes of the options given."""
    scheme = given.get("scheme", DEFAULT_SCHEME)
    if by == "setpoint" and scheme not in SCHEMES:
        raise UsageError(f"split: found the scheme {scheme!r}{meant(str(scheme), SCHEMES)}")
    refuse_unused(given, by, scheme)
    options = {name: value for name, value in given.items() if name != "scheme"}
    return split_schemes.SCHEMES[scheme if by == "setpoint" else by](spec, **options)


def _named(splits: Splits, prefix: str | None, names: Mapping[str, str]) -> Splits:
    """The splits under the names asked for."""
    if not splits and (prefix is not None or names):
        raise UsageError("split: found a name or a prefix, but no splits to make; expected a property")
    for name in names:
        if name not in splits:
            raise UsageError(f"split: found {name!r} to be renamed{meant(name, splits)}")
    named = {names.get(name, _prefixed(name, prefix)): split for name, split in splits.items()}
    if len(named) < len(splits):
        raise UsageError("split: found one name for two splits, expected different names")
    return named


def _prefixed(name: str, prefix: str | None) -> str:
    return name if prefix is None else f"{prefix}-{name}"


def _made_together(splits: Splits, names: Mapping[str, str]) -> set[str]:
    """The names of all splits that may have been made together with earlier splits of these names.

    Splits that get other names replace none, so what was made with earlier ones stays.
    """
    replaced = splits.keys() - names.keys()
    return {name for group in split_schemes.TOGETHER if group & replaced for name in group}


def _refuse_names(dataset: Dataset, spec: DatasetSpec, new: Splits) -> None:
    declared, valid = set(spec.declared), TypeAdapter(SplitName)
    for name in new:
        if name in declared:
            raise UsageError(
                f"{dataset.place}: {name} is a declared split, which has files of its own; choose another "
                "name with a prefix"
            )
        try:
            valid.validate_python(name)
        except ValidationError:
            raise UsageError(
                f"split: found the name {name!r}, expected at most 64 of a-z, 0-9, _ and -, and no name that "
                "is reserved"
            ) from None


def _refuse_removal(dataset: Dataset, spec: DatasetSpec, remove: Sequence[str]) -> None:
    for name in remove:
        if name in spec.declared:
            raise UsageError(
                f"{dataset.place}: {name} is a declared split, which has files of its own; it cannot be "
                "removed"
            )
        if name not in spec.later:
            known = meant(name, spec.later) if spec.later else ", expected no name: no splits were made later"
            raise UsageError(f"split: found {name!r} to be removed{known}")
