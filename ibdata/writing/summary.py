"""Summaries of shards: digests, returns and statistics, added up part by part."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from ibdata.dataset.digest import episode_digests
from ibdata.errors import IbdataError
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.simulation.rollout import Columns, parts, rollout
from ibdata.simulation.self_check import keeps_denormals
from ibdata.simulation.variables import Table, layout
from ibdata.writing.arrow import digest_runs
from ibdata.writing.statistics import SAMPLE_ROWS, Floats, Moments, merged, moments, sample_stride, sums


class ShardSummary(NamedTuple):
    """A summary of a shard's content, which does not depend on its file."""

    digests: list[bytes]  # of the episodes
    returns: Floats  # of the episodes, undiscounted
    moments: Moments  # of the float columns
    sample: Table  # of the float columns, for quantiles
    clipped: int
    labelled: dict[str, tuple[Moments, list[Table]]]  # of splits that are labels; samples in parts


# Stands for the content of a shard that was not read.
UNREAD = ShardSummary([], np.empty(0), Moments(0, *(np.empty(0) for _ in range(4))), np.empty((0, 0)), 0, {})


def content_of(digests: list[bytes]) -> str:
    """The hex digest of a shard's content, from the digests of its episodes."""
    return hashlib.sha256(b"".join(digests)).hexdigest()


def describe(spec: DatasetSpec, shard: Shard, made: Iterable[tuple[Shard, Columns]]) -> ShardSummary:
    """Summarize a shard from its parts. Raises IbdataError if a value is not finite."""
    account = ShardSummarizer(spec, shard)
    for part, floats in made:
        account.add(part, floats)
    return account.content()


def simulated(spec: DatasetSpec, shard: Shard) -> Iterator[tuple[Shard, Columns]]:
    """Simulate a shard part by part.

    Raises IbdataError if code of a policy switches denormal numbers off or on, on which bits may depend.
    """
    experiment, kept = spec.of_shard(shard), keeps_denormals()
    for first, stop in parts(experiment, shard.first, shard.stop):
        floats = rollout(experiment, first, stop)
        if keeps_denormals() != kept:
            raise IbdataError(
                f"{shard.stem}: a policy switched denormal numbers {'off' if kept else 'on'} in the middle "
                "of a run; do it where the policy's module is imported"
            )
        yield shard._replace(first=first, stop=stop), floats


class ShardSummarizer:
    """Summarizes a shard whose parts are added in order."""

    def __init__(self, spec: DatasetSpec, shard: Shard) -> None:
        self.shard, self.experiment = shard, spec.of_shard(shard)
        steps = self.experiment.steps
        self._runs = deque(spec.runs(shard) if spec.later else ())
        lengths: dict[str, int] = {}
        for first, stop, names in self._runs:
            for name in spec.later.keys() & set(names):
                lengths[name] = lengths.get(name, 0) + (stop - first) * steps
        self._all = _Rows((shard.stop - shard.first) * steps, self.experiment.rows)
        self._labelled = {name: _Rows(rows, self.experiment.rows) for name, rows in lengths.items()}
        self._digests: list[bytes] = []
        self._returns: list[Floats] = []
        self._clipped = 0

    def add(self, part: Shard, floats: Columns) -> Moments:
        """Add the next episodes of the shard; return the moments of their columns."""
        steps, table = self.experiment.steps, floats.table
        lengths = [steps] * (part.stop - part.first)
        self._digests += episode_digests(digest_runs(self.experiment, part, floats), lengths)
        self._returns.append(sums(table[floats.names.index("reward")], steps))
        own = self._all.add(table)
        for name, tables in self._of_splits(part, table).items():
            self._labelled[name].add(*tables)
        self._clipped += floats.clipped
        return own

    def _of_splits(self, part: Shard, table: Table) -> dict[str, list[Table]]:
        """The rows of a part that belong to each labelled split; drops the runs that end in the part."""
        steps, found = self.experiment.steps, dict[str, list[slice]]()
        while self._runs and self._runs[0][0] < part.stop:
            first, stop, names = self._runs[0]
            rows = slice(
                (max(first, part.first) - part.first) * steps, (min(stop, part.stop) - part.first) * steps
            )
            for name in self._labelled.keys() & set(names):
                own = found.setdefault(name, [])
                if own and own[-1].stop == rows.start:
                    own[-1] = slice(own[-1].start, rows.stop)
                else:
                    own.append(rows)
            if stop > part.stop:
                break
            self._runs.popleft()
        return {name: [table[:, rows] for rows in own] for name, own in found.items()}

    def content(self) -> ShardSummary:
        """The summary of all parts. Raises IbdataError if a value is not finite."""
        whole, samples = self._all.found()
        names = layout(self.experiment).names
        finite = np.isfinite(whole.squares)
        finite[names.index("action_log_prob")] = True  # a custom policy may not know its density
        if not finite.all():
            name = names[int(np.argmin(finite))]
            raise IbdataError(
                f"{self.shard.stem}: {name}: found a value that is not finite, expected finite numbers"
            )
        returns = np.concatenate(self._returns)
        labelled = {name: rows.found() for name, rows in self._labelled.items()}
        sample = np.concatenate(samples, axis=1)
        return ShardSummary(self._digests, returns, whole, sample, self._clipped, labelled)


class _Rows:
    """Moments and an evenly spaced sample of rows that are added in parts."""

    def __init__(self, rows: int, total: int) -> None:
        self._stride, self._seen = sample_stride(rows, total), 0
        self._whole = self._stride == 1 and total <= SAMPLE_ROWS
        self._moments: Moments | None = None
        self._samples: list[Table] = []

    def add(self, *tables: Table) -> Moments:
        """Add rows; return their moments. If all rows are sampled, views are kept instead of copies."""
        table = tables[0] if len(tables) == 1 else np.concatenate(tables, axis=1)
        own = moments(np.ascontiguousarray(table))
        self._moments = own if self._moments is None else merged(self._moments, own)
        if self._whole:
            self._samples += tables
        else:
            self._samples.append(np.ascontiguousarray(table[:, -self._seen % self._stride :: self._stride]))
        self._seen += table.shape[1]
        return own

    def found(self) -> tuple[Moments, list[Table]]:
        assert self._moments is not None
        return self._moments, self._samples
