"""The recorded episodes of a dataset, part by part, with the ratios of the densities of their actions."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata.dataset.reader import Dataset
from ibdata.evaluation.overlap import log_ratios
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.policies import Policy
from ibdata.simulation.episodes import Floats
from ibdata.simulation.rollout import PART_ROWS, parts


class Part(NamedTuple):
    """Consecutive episodes of a shard with the same policy, of which some are selected."""

    shard: int
    first: int  # episode of the experiment
    stop: int
    row: int  # of the shard
    steps: int
    behaviour: Policy
    selected: npt.NDArray[np.bool_]  # (stop - first,)


def parts_of(spec: DatasetSpec, episodes: npt.NDArray[np.int64]) -> Iterator[Part]:
    """Yield the parts that have episodes of these numbers."""
    for shard in spec.shards:
        experiment = spec.of_shard(shard)
        per_policy = experiment.episodes * (len(experiment.cells) // len(experiment.policies))
        inside = np.isin(np.arange(shard.first, shard.stop) + shard.offset, episodes)
        inner = range((shard.first // per_policy + 1) * per_policy, shard.stop, per_policy)
        of_one = pairwise([shard.first, *inner, shard.stop])
        for first, stop in (part for ends in of_one for part in parts(experiment, *ends)):
            selected = inside[first - shard.first : stop - shard.first]
            if selected.any():
                row = (first - shard.first) * experiment.steps
                behaviour = experiment.cells[first // experiment.episodes].policy
                yield Part(shard.number, first, stop, row, experiment.steps, behaviour, selected)


def read(ds: Dataset, spec: DatasetSpec, part: Part, target: Policy) -> tuple[Floats, Floats]:
    """The logarithms of the ratios and the rewards of the selected episodes, both (episodes, steps)."""
    experiment, n = spec.of_shard(spec.shards[part.shard]), part.stop - part.first
    observed, acted = ds.info_model.names("observation"), ds.info_model.names("action")
    names = [*observed, *acted, "reward", "action_log_prob"]
    stop = part.row + n * part.steps
    table = pa.Table.from_batches(ds.shard_batches(part.shard, names, PART_ROWS, part.row, stop))

    def grid(names: list[str]) -> npt.NDArray[np.float32]:
        columns = [table[name].to_numpy() for name in names]
        return np.stack(columns, axis=1).astype(np.float32).reshape(n, part.steps, len(names))

    reward, log_prob = (
        table[name].to_numpy().astype(np.float64).reshape(n, part.steps)
        for name in ("reward", "action_log_prob")
    )
    ratios = log_ratios(experiment, part.first, part.stop, grid(observed), grid(acted), log_prob, target)
    return ratios[part.selected], reward[part.selected]
