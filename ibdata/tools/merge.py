"""Merging datasets with the same columns into one."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from ibdata._numerics.arguments import public
from ibdata._numerics.naming import NAME_PATTERN, counted, exact
from ibdata.dataset.dataset import Dataset
from ibdata.errors import UsageError, excerpt, parameter
from ibdata.experiment import Experiment
from ibdata.experiment.columns import columns
from ibdata.experiment.dataset_spec import DatasetSpec, spec_in
from ibdata.policies.user_object import ObjectPolicy
from ibdata.tools.rewrite import Source, sources_of, write_dataset


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
    recipes = [spec_in(d.stored).all_declared() for d in datasets]
    sources = [source for d, spec in zip(datasets, recipes, strict=True) for source in sources_of(d, spec)]
    experiments = tuple(experiment for spec in recipes for experiment in spec.experiments)
    for b, y in zip(experiments[1:], sources[1:], strict=True):
        _refuse_other_kind(experiments[0], b, sources[0], y)
    _refuse_shared_episodes(experiments, sources)
    _refuse_equal_digests(datasets)
    name = Path(out).name
    return write_dataset(
        DatasetSpec(name if re.fullmatch(NAME_PATTERN, name) else "merged", experiments), sources, out
    )


def _refuse_other_kind(a: Experiment, b: Experiment, x: Source, y: Source) -> None:
    kinds = [{c.name: c.dtype for c in columns(e)} for e in (a, b)]
    for name in dict.fromkeys([*kinds[0], *kinds[1]]):
        types = [kind.get(name, "none") for kind in kinds]
        if types[0] != types[1]:
            raise UsageError(
                f"{y.dataset.place}: column {name}: found {types[1]}, expected {types[0]} "
                f"as in {x.dataset.place}"
            )
    if a.drifting != b.drifting:
        raise UsageError(
            f"{y.dataset.place}: found {'moving' if b.drifting else 'constant'} setpoints, expected "
            f"{'moving' if a.drifting else 'constant'} ones as in {x.dataset.place}"
        )
    for name in ("dynamics", "start"):  # no column tells them apart
        first, second = (getattr(e.cells[0], name) for e in (a, b))
        if first != second:
            raise UsageError(
                f"{y.dataset.place}: {name}: found {excerpt(second)}, expected {excerpt(first)} as in "
                f"{x.dataset.place}; keep both datasets, and join their arrays by numpy.concatenate"
            )


def _refuse_shared_episodes(experiments: Sequence[Experiment], sources: Sequence[Source]) -> None:
    """Refuse equal seeds and cells: their episodes are equal, or one is the beginning of the other."""
    owners: dict[tuple[int, bytes], Source] = {}
    for experiment, source in zip(experiments, sources, strict=True):
        for cell in experiment.cells:
            known = owners.setdefault((experiment.seed, cell.digest), source)
            if known is not source:
                remedy = "name one of the objects, or " if any(cell.policy.everywhere(ObjectPolicy)) else ""
                raise UsageError(
                    f"{source.dataset.place}: setpoint {exact(cell.setpoint)}, policy {cell.label}: the "
                    f"same episodes are also in {known.dataset.place}; {remedy}make one of the datasets with "
                    f"another {parameter('seed')}"
                )


def _refuse_equal_digests(datasets: list[Dataset]) -> None:
    owners: dict[bytes, Dataset] = {}
    for dataset in datasets:
        for episode, digest in enumerate(dataset.stored.episodes["digest"].to_pylist()):
            if digest in owners:
                raise UsageError(
                    f"{dataset.place}: episode {episode} is also in {owners[digest].place}; "
                    "leave one of the datasets out"
                )
            owners[digest] = dataset
