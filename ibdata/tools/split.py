"""Splitting a finished dataset: labels on its episodes, or a copy whose splits are whole files."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from ibdata._numerics.arguments import public
from ibdata.dataset.dataset import Dataset, Place, to_write
from ibdata.errors import UsageError, meant
from ibdata.experiment.fields import Split
from ibdata.plan.dataset_spec import DatasetSpec, spec_in
from ibdata.tools.rewrite import relabel, write_dataset

SplitDefinition = Annotated[Mapping[str, Any] | Split | None, "a mapping such as {'setpoint': 20}"]
SplitsArg = Annotated[Mapping[str, SplitDefinition] | None, "a mapping such as {'calm': {'setpoint': 20}}"]


@public
def split(
    dataset: Place,
    splits: SplitsArg = None,
    *,
    remove: str | Sequence[str] = (),
    materialize: str | os.PathLike[str] | None = None,
) -> Dataset:
    """Split a dataset by setpoint, policy or episode, and open it.

    The splits are labels on episodes: nothing is copied and no row changes. A split of the same name that an
    earlier call made is replaced.

    Args:
        dataset: A dataset, or its folder.
        splits: The splits by name, as `splits:` of an experiment has them, such as {"calm": {"setpoint":
            [10, 20], "policy": "safe"}, "first": {"setpoint": 50, "episodes": 2}}. Those of one call share no
            episodes, unless they have "overlap": True. None removes the split of that name, if there is one.
            The functions of `ibdata.tools.split_schemes` return such mappings.
        remove: The name or names of splits to remove. A declared split has files of its own and stays.
        materialize: The folder for a copy with the same content root, in which every split consists of whole
            files; the dataset itself does not change.

    Returns:
        The dataset, or the copy.

    Raises:
        UsageError: A split is invalid, or names what the dataset lacks.
        DatasetError: The dataset is damaged.
    """
    dataset, splits = to_write(dataset), splits or {}
    spec = spec_in(dataset.stored)
    remove = [remove] if isinstance(remove, str) else remove
    if not (splits or remove or materialize):
        raise UsageError("split: found nothing to do, expected splits, names to remove, or materialize")
    for name in (*splits, *remove):
        if name in spec.declared:
            raise UsageError(
                f"{dataset.place}: {name} is a declared split, which has files of its own and stays as it "
                "is; choose another name"
            )
    for name in remove:
        if name not in spec.later:
            known = meant(name, spec.later) if spec.later else ", expected no name: no splits were made later"
            raise UsageError(f"split: found {name!r} to be removed{known}")
    new = spec.checked({name: each for name, each in splits.items() if each is not None})
    gone = {*remove, *splits} - new.keys()
    later = {name: each for name, each in spec.later.items() if name not in gone}
    labelled = DatasetSpec(spec.name, spec.experiments, {**later, **new})
    if materialize is None:
        return relabel(dataset, spec, labelled)
    return write_dataset(labelled.all_declared(), dataset, materialize)
