"""The content of the files in `meta/` but for experiments, weights and manifest."""

from __future__ import annotations

import json
from functools import reduce
from itertools import chain
from typing import Any

import numpy as np
import pyarrow as pa

from ibdata._numerics.arrays import Ints
from ibdata.dataset.models import ColumnEntry, Counts, Info, JsonObject, SplitEntry, Statistics
from ibdata.dataset.statistics import merged, statistics_of_columns
from ibdata.dataset.stored import episode_schema
from ibdata.generation.pieces import arrow_array, arrow_strings, arrow_texts
from ibdata.generation.shard import WrittenShard
from ibdata.plan.columns import columns, layout
from ibdata.plan.dataset_spec import DatasetSpec, Shard
from ibdata.plan.rollout import acting_in


def as_json(data: Any) -> bytes:
    """The bytes of a JSON file: indented, without NaN, ending in a newline."""
    data = data.plain() if isinstance(data, JsonObject) else data
    return (json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def info(spec: DatasetSpec) -> Info:
    """Make dataset.json: columns with their meaning, and counts."""
    return Info(
        format="ibdata-dataset",
        version=1,
        name=spec.name,
        dynamics=spec.experiments[0].cells[0].dynamics,
        drifting=spec.experiments[0].drifting,
        start=spec.experiments[0].plain()["start"],
        counts=Counts(
            rows=spec.rows,
            episodes=spec.episodes,
            steps=spec.experiments[0].steps if len({e.steps for e in spec.experiments}) == 1 else None,
            cells=len({cell.digest for e in spec.experiments for cell in e.cells}),
            shards=len(spec.shards),
        ),
        columns=[
            ColumnEntry(**{name: getattr(column, name) for name in ColumnEntry.model_fields})
            for column in columns(spec.experiments[0])
        ],
    )


def splits(spec: DatasetSpec) -> dict[str, SplitEntry]:
    """The splits of a dataset, declared and later."""
    entries = {}
    for name in spec.declared:
        shards = [shard for shard in spec.shards if name in shard.splits]
        episodes = sum(shard.stop - shard.first for shard in shards)
        entries[name] = SplitEntry(episodes=episodes, rows=spec.rows_in(shards), declared=True)
    for name, runs in spec.later_runs().items():
        entries[name] = SplitEntry(
            episodes=sum(stop - first for first, stop, _ in runs),
            rows=sum((stop - first) * steps for first, stop, steps in runs),
            declared=False,
            split=spec.later[name].model_dump(mode="json", exclude_none=True),
            runs=[[first, stop] for first, stop, _ in runs],
        )
    return entries


def splits_file(spec: DatasetSpec) -> bytes:
    """The bytes of splits.json, which the manifest does not list: it is all that later splits replace."""
    return as_json({name: entry.plain() for name, entry in splits(spec).items()})


def episodes_table(spec: DatasetSpec, written: list[WrittenShard]) -> pa.Table:
    """The table of episodes, with one row per episode."""
    shards = [w.shard for w in written]
    experiments = [spec.experiments[shard.experiment] for shard in shards]
    numbers = [np.arange(shard.first, shard.stop) for shard in shards]
    counts = [len(of_shard) for of_shard in numbers]
    cells = [cell for experiment in spec.experiments for cell in experiment.cells]
    first_cells = np.cumsum([0, *(len(experiment.cells) for experiment in spec.experiments)])
    cell_numbers, indices = [], []
    for shard, of_shard in zip(shards, numbers, strict=True):
        cell_number, index = np.divmod(of_shard, spec.experiments[shard.experiment].episodes)
        cell_numbers.append(first_cells[shard.experiment] + cell_number)
        indices.append(index)
    cell_of = np.concatenate(cell_numbers)
    setpoints = np.array([cell.setpoint for cell in cells])
    dtype = spec.experiments[0].output.dtype  # as in the rows, to which the table is joined …
    if len(np.unique(setpoints.astype(dtype))) < len(np.unique(setpoints)):
        dtype = "float64"  # … unless that makes two setpoints one
    length = np.repeat([experiment.steps for experiment in experiments], counts)
    row_start = np.concatenate([np.arange(n) * e.steps for n, e in zip(counts, experiments, strict=True)])
    digests = [digest for w in written for digest in w.summary.digests]
    arrays: list[pa.Array] = [
        arrow_array(np.concatenate([n + shard.offset for shard, n in zip(shards, numbers, strict=True)])),
        _texts([cell.digest.hex() for cell in cells], cell_of),
        arrow_array(np.concatenate(indices)),
        arrow_array(setpoints[cell_of].astype(dtype)),
        _texts([cell.label for cell in cells], cell_of),
        _acting(spec, shards),
        _lists([shard.splits for shard in shards], counts),
        arrow_array(length),
        arrow_array(np.concatenate([w.summary.returns for w in written])),
        arrow_array(np.repeat(np.array([shard.number for shard in shards], dtype=np.int32), counts)),
        arrow_array(row_start),
        arrow_array(row_start + length),
        pa.Array.from_buffers(pa.binary(32), len(digests), [None, pa.py_buffer(b"".join(digests))]),
    ]
    return pa.table(arrays, schema=episode_schema(dtype))


def _texts(texts: list[str], numbers: Ints) -> pa.DictionaryArray:
    """A column that holds, in each row, the text with this number; a text may have several numbers."""
    known = {text: i for i, text in enumerate(dict.fromkeys(texts))}
    return arrow_texts(np.array([known[text] for text in texts], np.int32)[numbers], list(known))


def _acting(spec: DatasetSpec, shards: list[Shard]) -> pa.DictionaryArray:
    """The policy that acts in each episode of shards; of a mixture, the one that was drawn for it."""
    known: dict[str, int] = {}
    numbers = []
    for shard in shards:
        names, acting = acting_in(spec.experiments[shard.experiment], np.arange(shard.first, shard.stop))
        distinct, indices = np.unique(acting, return_inverse=True)
        known_numbers = [known.setdefault(names[i], len(known)) for i in distinct.tolist()]
        numbers.append(np.array(known_numbers, dtype=np.int32)[indices])
    return arrow_texts(np.concatenate(numbers), list(known))


def _lists(lists: list[tuple[str, ...]], counts: list[int]) -> pa.ListArray:
    """A column that repeats each list of texts as often as its count says."""
    lengths = np.repeat([len(texts) for texts in lists], counts)
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    repeated = chain.from_iterable(texts * count for texts, count in zip(lists, counts, strict=True))
    return pa.ListArray.from_arrays(arrow_array(offsets), arrow_strings(list(repeated)))


def statistics(spec: DatasetSpec, written: list[WrittenShard]) -> Statistics:
    """Make statistics.json: statistics of every float column, over all rows and over each declared split."""
    names = layout(spec.experiments[0]).names
    found = []
    for split in (None, *spec.declared):
        summaries = [w.summary for w in written if split is None or split in w.shard.splits]
        moments = [summary.moments for summary in summaries]
        samples, rows = [summary.sample for summary in summaries], [each.rows for each in moments]
        found.append(statistics_of_columns(names, reduce(merged, moments), samples, rows))
    splits_found = dict(zip(spec.declared, found[1:], strict=True))
    return Statistics(format="ibdata-statistics", version=1, all=found[0], splits=splits_found)
