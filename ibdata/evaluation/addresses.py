"""The addresses of the random numbers of a dataset's episodes, by which they can be simulated again."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.dataset.reader import Dataset
from ibdata.errors import UsageError, excerpt
from ibdata.experiment import Experiment
from ibdata.experiment.dataset_spec import DatasetSpec, spec_in
from ibdata.writing.planned import refuse_other_plan

Ints = npt.NDArray[np.int64]


class Addresses:
    """The addresses of a dataset's episodes. Raises DatasetError if this ibdata makes other episodes."""

    def __init__(self, ds: Dataset, spec: DatasetSpec | None = None) -> None:
        self._spec = spec or spec_in(ds, ds.manifest_model)
        refuse_other_plan(self._spec, ds.manifest_model)
        names = ("length", "shard", "row_start")
        self.lengths, self.shards, self.starts = (ds.episode_table[name].to_numpy() for name in names)

    def episodes(self, numbers: Any) -> Ints:
        """Numbers of episodes as an array (n,). Raises UsageError if the dataset has no such episode."""
        return within("episode", numbers, len(self.lengths))

    def by_experiment(self, episodes: Ints) -> Iterator[tuple[Experiment, Ints, Ints]]:
        """Group episodes (n,): yield an experiment, the places of its episodes, and their numbers in it."""
        shards = [self._spec.shards[i] for i in self.shards[episodes].tolist()]
        experiments = np.array([shard.experiment for shard in shards])
        offsets = np.array([shard.offset for shard in shards])
        for i in np.unique(experiments).tolist():
            places = np.flatnonzero(experiments == i)
            yield self._spec.experiments[i], places, episodes[places] - offsets[places]


def whole(what: str, value: Any) -> Ints:
    """Whole numbers (n,) from a number or an array."""
    numbers = np.asarray(value)
    if numbers.dtype.kind not in "iu" or numbers.ndim > 1:
        raise UsageError(f"{what}: found {excerpt(value)}, expected whole numbers")
    return np.atleast_1d(numbers).astype(np.int64)


def within(what: str, value: Any, count: int) -> Ints:
    """Whole numbers (n,) from 0 to count - 1."""
    numbers = whole(what, value)
    wrong = (numbers < 0) | (numbers >= count)
    if wrong.any():
        raise UsageError(f"{what}: found {numbers[np.argmax(wrong)]}, expected one of 0 to {count - 1}")
    return numbers
