"""Summaries of shards: digests, returns and statistics, added up part by part."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from ibdata.dataset.digest import episode_digests
from ibdata.dataset.statistics import Floats, Moments, RowStatistics, sums
from ibdata.errors import IbdataError
from ibdata.experiment.columns import layout
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.experiment.rollout import Columns, TableBuffer, parts, rollout
from ibdata.simulation.variables import Table
from ibdata.writing.arrow import digest_runs


class ShardSummary(NamedTuple):
    """A summary of a shard's content, which does not depend on its file."""

    digests: list[bytes]  # of the episodes
    returns: Floats  # of the episodes, undiscounted
    moments: Moments  # of the float columns
    sample: Table  # of the float columns, for quantiles
    clipped: int


# Stands for the content of a shard that was not read.
UNREAD = ShardSummary([], np.empty(0), Moments(0, *(np.empty(0) for _ in range(4))), np.empty((0, 0)), 0)


def content_of(digests: list[bytes]) -> str:
    """The hex digest of a shard's content, from the digests of its episodes."""
    return hashlib.sha256(b"".join(digests)).hexdigest()


def describe(spec: DatasetSpec, shard: Shard, made: Iterable[tuple[Shard, Columns]]) -> ShardSummary:
    """Summarize a shard from its parts. Raises IbdataError if a value is not finite."""
    account = ShardSummarizer(spec, shard)
    for part, floats in made:
        account.add(part, floats)
    return account.content()


def simulated(
    spec: DatasetSpec, shard: Shard, memory: TableBuffer | None = None
) -> Iterator[tuple[Shard, Columns]]:
    """Simulate a shard part by part. With `memory`, a part is gone when the next one is made."""
    experiment = spec.of_shard(shard)
    for first, stop in parts(experiment, shard.first, shard.stop):
        made = rollout(experiment, first, stop, memory)
        yield shard._replace(first=first, stop=stop), made
        del made  # so that it is not in memory beside the next


class ShardSummarizer:
    """Summarizes a shard whose parts are added in order."""

    def __init__(self, spec: DatasetSpec, shard: Shard) -> None:
        self.shard, self.experiment = shard, spec.of_shard(shard)
        rows = (shard.stop - shard.first) * self.experiment.steps
        self._statistics = RowStatistics(rows, self.experiment.rows)
        self._digests: list[bytes] = []
        self._returns: list[Floats] = []
        self._clipped = 0

    def add(self, part: Shard, floats: Columns) -> Moments:
        """Add the next episodes of the shard; return the moments of their columns."""
        steps, table = self.experiment.steps, floats.table
        lengths = [steps] * (part.stop - part.first)
        self._digests += episode_digests(digest_runs(self.experiment, part, floats), lengths)
        self._returns.append(sums(table[floats.names.index("reward")], steps))
        self._clipped += floats.clipped
        return self._statistics.add(table)

    def content(self) -> ShardSummary:
        """The summary of all parts. Raises IbdataError if a value is not finite."""
        found = self._statistics.moments
        names = layout(self.experiment).names
        finite = np.isfinite(found.squares)
        finite[names.index("action_log_prob")] = True  # a custom policy may not know its density
        if not finite.all():
            name = names[int(np.argmin(finite))]
            raise IbdataError(
                f"{self.shard.stem}: {name}: found a value that is not finite, expected finite numbers"
            )
        returns = np.concatenate(self._returns)
        return ShardSummary(self._digests, returns, found, self._statistics.sample, self._clipped)
