"""The distribution of episodes to files, a pure function of the experiment."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

from ibdata.experiment.fields import Split
from ibdata.experiment.models import Experiment


class Shard(NamedTuple):
    """Episodes first … stop - 1 of an experiment, all in the same splits.

    A merged dataset has several experiments: `experiment` is the number of this one, `offset` the number of
    episodes of the dataset before it.
    """

    number: int
    first: int
    stop: int
    splits: tuple[str, ...]
    experiment: int = 0
    offset: int = 0

    @property
    def stem(self) -> str:
        """The beginning of the shard's path inside the dataset; a token follows."""
        return f"data/part-{self.number:05d}"


def plan(experiment: Experiment) -> list[Shard]:
    """The shards in order. A shard has whole episodes, at least one, and at most `output.shard_rows` rows.

    A new shard begins where a declared split begins or ends, so that every split consists of whole files.
    """
    per_shard = episodes_per_shard(experiment)
    shards: list[Shard] = []
    for first, stop, splits in segments(experiment, experiment.splits):
        for start in range(first, stop, per_shard):
            shards.append(Shard(len(shards), start, min(start + per_shard, stop), splits))
    return shards


def episodes_per_shard(experiment: Experiment) -> int:
    """The largest number of episodes of a shard."""
    return max(1, experiment.output.shard_rows // experiment.steps)


def segments(experiment: Experiment, splits: Mapping[str, Split]) -> list[tuple[int, int, tuple[str, ...]]]:
    """The longest runs (first, stop, splits) of episodes in the same splits."""
    n = experiment.episodes
    cuts = {0, n}
    for split in splits.values():
        indices = split.indices(n)
        cuts |= {min(n, indices.start), min(n, indices.stop)}
    bounds = sorted(cuts)
    order = list(splits)
    anywhere = {k for k, split in enumerate(splits.values()) if split.setpoint is None}
    by_setpoint = _selecting(split.setpoints() or () for split in splits.values())
    by_label = _selecting(split.policies() or experiment.labels for split in splits.values())
    by_index = _selecting([low for low in bounds if low in split.indices(n)] for split in splits.values())
    runs: list[tuple[int, int, tuple[str, ...]]] = []
    for i, cell in enumerate(experiment.cells):
        of_cell = (by_setpoint[cell.setpoint] | anywhere) & by_label[cell.label]
        for low, high in pairwise(bounds):
            names = tuple(order[k] for k in sorted(of_cell & by_index[low]))
            if runs and runs[-1][2] == names:
                runs[-1] = (runs[-1][0], i * n + high, names)
            else:
                runs.append((i * n + low, i * n + high, names))
    return runs


def _selecting(selected: Iterable[Iterable[Any]]) -> defaultdict[Any, set[int]]:
    """For each value, the numbers of the splits that select it."""
    found = defaultdict[Any, set[int]](set)
    for k, values in enumerate(selected):
        for value in values:
            found[value].add(k)
    return found
