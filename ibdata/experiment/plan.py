"""Which episodes go into which file: a pure function of the experiment."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

from ibdata.experiment.models import Experiment, splits_of


class Shard(NamedTuple):
    """Episodes first … stop - 1 of the dataset, all in the same splits."""

    number: int
    first: int
    stop: int
    splits: tuple[str, ...]

    @property
    def file(self) -> str:
        """The shard's path inside the dataset."""
        return f"data/part-{self.number:05d}.parquet"


def plan(experiment: Experiment) -> list[Shard]:
    """The shards in order: whole episodes, at most `output.shard_rows` rows where an episode fits.

    A shard is cut where a declared split begins or ends, so that every split is made of whole files.
    """
    per_shard = max(1, experiment.output.shard_rows // experiment.steps)
    shards: list[Shard] = []
    for first, stop, splits in _segments(experiment):
        for start in range(first, stop, per_shard):
            shards.append(Shard(len(shards), start, min(start + per_shard, stop), splits))
    return shards


def _segments(experiment: Experiment) -> list[tuple[int, int, tuple[str, ...]]]:
    """The longest runs of episodes that are in the same splits."""
    n = experiment.episodes
    cuts = {0, n}
    for split in experiment.splits.values():
        cuts |= {split.indices(n).start, split.indices(n).stop}
    bounds = sorted(cuts)
    runs: list[tuple[int, int, tuple[str, ...]]] = []
    for i, cell in enumerate(experiment.cells):
        for low, high in pairwise(bounds):
            splits = splits_of(experiment.splits, cell, low, n)
            if runs and runs[-1][2] == splits:
                runs[-1] = (runs[-1][0], i * n + high, splits)
            else:
                runs.append((i * n + low, i * n + high, splits))
    return runs
