"""Reproducing a dataset from its own experiment, in memory, and comparing every episode."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq

from ibdata.dataset import manifest
from ibdata.dataset.digest import episode_digests
from ibdata.dataset.rules import Problem
from ibdata.dataset.schema import digest_runs
from ibdata.engines.warmup import warm_up
from ibdata.errors import UsageError
from ibdata.experiment import Experiment
from ibdata.experiment.plan import Shard, plan
from ibdata.rollout import rollout


def reproduce(folder: str | os.PathLike[str], episodes: str | None = None) -> tuple[int, list[Problem]]:
    """How many episodes were made again, and those that have another digest than the dataset lists.

    episodes is a number, of episodes spread evenly, or a range such as 500-600; None means all. Nothing is
    written. Raises DatasetError where there is no finished dataset, UsageError for other episodes.
    """
    path = Path(folder)
    listed = manifest.read(path)
    experiment = Experiment.model_validate(listed["experiment"])
    table = pq.read_table(manifest.locate(path, "meta/episodes.parquet"), columns=["digest", "shard"])
    digests, shards = table["digest"].to_pylist(), table["shard"].to_pylist()
    warm_up(experiment)
    count, problems = 0, []
    for part in _parts(experiment, episodes, len(digests)):
        floats = rollout(experiment, part.first, part.stop)
        lengths = [experiment.steps] * (part.stop - part.first)
        found = episode_digests(digest_runs(experiment, part, floats), lengths)
        count += len(found)
        for episode, digest in enumerate(found, part.first):
            if digest != digests[episode]:
                shard = listed["shards"][shards[episode]]
                row = (episode - shard["episodes"][0]) * experiment.steps
                message = f"episode {episode}: found other content when made again"
                problems.append(Problem(shard["path"], row, "reproduce", message))
    return count, problems


def _parts(experiment: Experiment, episodes: str | None, total: int) -> Iterator[Shard]:
    if episodes is None:
        yield from plan(experiment)
        return
    first, dash, last = episodes.partition("-")
    if not first.isascii() or not first.isdigit() or (dash and not (last.isascii() and last.isdigit())):
        raise UsageError(f"--episodes: found {episodes!r}, expected a number or a range such as 500-600")
    if not dash:
        number = min(total, int(first))
        yield from (Shard(0, i * total // number, i * total // number + 1, ()) for i in range(number))
        return
    if not int(first) <= int(last) < total:
        raise UsageError(f"--episodes: found {episodes}, expected a range within 0-{total - 1}")
    yield Shard(0, int(first), int(last) + 1, ())
