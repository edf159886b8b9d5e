"""Merging datasets with the same columns into one."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from ibdata._numerics.arguments import public
from ibdata._numerics.naming import NAME_PATTERN, counted
from ibdata.dataset.dataset import Dataset
from ibdata.errors import UsageError
from ibdata.plan.dataset_spec import DatasetSpec, spec_in
from ibdata.tools.rewrite import write_dataset


@public
def merge(folders: Sequence[str | os.PathLike[str]], out: str | os.PathLike[str]) -> Dataset:
    """Merge datasets into a new one, with all their splits.

    The episodes get new numbers and keep their digests; the new content root is that of all of them. Splits
    with the same name are joined. Splits that were only labels get files of their own.

    Args:
        folders: The folders of two or more datasets with the same columns, dynamics and start.
        out: The folder of the new dataset.

    Raises:
        UsageError: There are fewer than two datasets, columns, dynamics or starts differ, or two datasets
            share an episode or the beginning of one, so that data could leak from one split into another.
        DatasetError: A dataset does not match its manifest.
    """
    if len(folders) < 2:
        raise UsageError(f"merge: found {counted(len(folders), 'dataset')}, expected at least 2")
    datasets = [Dataset(folder) for folder in folders]
    source = Dataset(datasets)
    recipes = [spec_in(dataset.stored).all_declared() for dataset in datasets]
    experiments = tuple(experiment for spec in recipes for experiment in spec.experiments)
    name = Path(out).name if re.fullmatch(NAME_PATTERN, Path(out).name) else "merged"
    return write_dataset(DatasetSpec(name, experiments), source, out)
