"""Distribute episodes to files. The plan depends on the experiment only."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from ibdata.experiment.fields import Split

if TYPE_CHECKING:
    from ibdata.experiment.models import Experiment


class Shard(NamedTuple):
    """Episodes first … stop - 1 of an experiment, all in the same splits.

    A merged dataset has several experiments. `experiment` is the index of this one, and `offset` is the
    number of episodes in the experiments before it.
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
    """The largest number of episodes in a shard."""
    return max(1, experiment.output.shard_rows // experiment.steps)


def segments(experiment: Experiment, splits: Mapping[str, Split]) -> list[tuple[int, int, tuple[str, ...]]]:
    """The longest ranges (first, stop, splits) of episodes that are in the same splits."""
    n = experiment.episodes
    indices = {name: split.indices(n) for name, split in splits.items()}
    ends = (end for selected in indices.values() for end in (selected.start, selected.stop))
    borders = sorted({0, n, *(min(n, end) for end in ends)})
    runs: list[tuple[int, int, tuple[str, ...]]] = []
    for i, cell in enumerate(experiment.cells):
        cell_splits = [name for name, split in splits.items() if split.selects(cell.setpoint, cell.label)]
        for low, high in pairwise(borders):
            names = tuple(name for name in cell_splits if low in indices[name])
            if runs and runs[-1][2] == names:
                runs[-1] = (runs[-1][0], i * n + high, names)
            else:
                runs.append((i * n + low, i * n + high, names))
    return runs
