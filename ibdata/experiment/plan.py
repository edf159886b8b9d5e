"""Which episodes go into which file: a pure function of the experiment."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

from ibdata.experiment.fields import Split
from ibdata.experiment.models import Experiment, splits_of


class Shard(NamedTuple):
    """Episodes first … stop - 1 of an experiment, all in the same of its splits.

    A merged dataset holds several experiments, one after another: this one's number, and the dataset's
    episodes before it.
    """

    number: int
    first: int
    stop: int
    splits: tuple[str, ...]
    experiment: int = 0
    offset: int = 0

    @property
    def stem(self) -> str:
        """What the shard's path inside the dataset begins with; a token of the file's content follows."""
        return f"data/part-{self.number:05d}"


def plan(experiment: Experiment) -> list[Shard]:
    """The shards in order: whole episodes, at most `output.shard_rows` rows where an episode fits.

    A shard is cut where a declared split begins or ends, so that every split is made of whole files.
    """
    per_shard = max(1, experiment.output.shard_rows // experiment.steps)
    shards: list[Shard] = []
    for first, stop, splits in segments(experiment, experiment.splits):
        for start in range(first, stop, per_shard):
            shards.append(Shard(len(shards), start, min(start + per_shard, stop), splits))
    return shards


def segments(experiment: Experiment, splits: Mapping[str, Split]) -> list[tuple[int, int, tuple[str, ...]]]:
    """The longest runs of episodes that are in the same splits."""
    n = experiment.episodes
    cuts = {0, n}
    for split in splits.values():
        indices = split.indices(n)
        cuts |= {min(n, indices.start), min(n, indices.stop)}
    bounds = sorted(cuts)
    runs: list[tuple[int, int, tuple[str, ...]]] = []
    for i, cell in enumerate(experiment.cells):
        for low, high in pairwise(bounds):
            names = splits_of(splits, cell, low, n)
            if runs and runs[-1][2] == names:
                runs[-1] = (runs[-1][0], i * n + high, names)
            else:
                runs.append((i * n + low, i * n + high, names))
    return runs
