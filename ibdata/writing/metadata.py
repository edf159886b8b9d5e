"""The content of the files in `meta/` but for experiments, weights and manifest."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterable, Sequence
from functools import reduce
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from ibdata.dataset.models import (
    Column,
    Counts,
    Info,
    JsonObject,
    Manifest,
    SplitEntry,
    Statistic,
    Statistics,
)
from ibdata.dataset.statistics import described, merged
from ibdata.dataset.stored import episode_schema
from ibdata.experiment.columns import columns, layout
from ibdata.experiment.dataset_spec import DatasetSpec, Run, Shard
from ibdata.experiment.rollout import acting_in
from ibdata.experiment.scenario import Cell
from ibdata.writing.columns import arrow_array, arrow_strings, arrow_texts
from ibdata.writing.shard import UNREAD, ShardSummary, WrittenShard


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
        dynamics=_common([e.plain()["dynamics"] for e in spec.experiments]),
        drifting=spec.experiments[0].drifting,
        start=_common([e.plain()["start"] for e in spec.experiments]),
        counts=Counts(
            rows=spec.rows,
            episodes=spec.episodes,
            steps=_common([e.steps for e in spec.experiments]),
            cells=len({cell.digest for e in spec.experiments for cell in e.cells}),
            shards=len(spec.shards),
        ),
        columns=[
            Column(**{name: getattr(column, name) for name in Column.model_fields})
            for column in columns(spec.experiments[0])
        ],
    )


def _common(values: list[Any]) -> Any:
    """The value of all, or None if they differ."""
    return values[0] if all(value == values[0] for value in values) else None


def splits(spec: DatasetSpec) -> dict[str, SplitEntry]:
    """The splits of a dataset, declared and later."""
    declared = {name: _declared(spec, name) for name in spec.declared}
    later = {name: _later(spec, name, runs) for name, runs in spec.later_runs().items()}
    return {**declared, **later}


def _declared(spec: DatasetSpec, name: str) -> SplitEntry:
    shards = [shard for shard in spec.shards if name in shard.splits]
    return SplitEntry(
        episodes=sum(shard.stop - shard.first for shard in shards),
        rows=spec.rows_in(shards),
        declared=True,
    )


def _later(spec: DatasetSpec, name: str, runs: Sequence[Run]) -> SplitEntry:
    return SplitEntry(
        episodes=sum(run.stop - run.first for run in runs),
        rows=sum((run.stop - run.first) * run.steps for run in runs),
        declared=False,
        split=spec.later[name].model_dump(mode="json", exclude_none=True),
        runs=[[run.first, run.stop] for run in runs],
    )


def splits_file(spec: DatasetSpec) -> bytes:
    """The bytes of splits.json, which the manifest does not list: it is all that later splits replace."""
    return as_json({name: entry.plain() for name, entry in splits(spec).items()})


def unread_shards(spec: DatasetSpec, listed: Manifest) -> list[WrittenShard]:
    """The shards of a finished dataset without their content, as its card needs them."""
    entries = listed.entries()
    pairs = zip(spec.shards, listed.shards, strict=True)
    return [WrittenShard(shard, entries[listed_shard.path], UNREAD) for shard, listed_shard in pairs]


def episodes_parquet(table: pa.Table) -> bytes:
    """The bytes of episodes.parquet."""
    out = io.BytesIO()
    pq.write_table(table, out, compression="zstd", write_page_checksum=True)
    return out.getvalue()


def episodes_table(spec: DatasetSpec, written: list[WrittenShard]) -> pa.Table:
    """The table of episodes, with one row per episode."""
    shards = [w.shard for w in written]
    experiments = [spec.experiments[shard.experiment] for shard in shards]
    numbers = [np.arange(shard.first, shard.stop) for shard in shards]
    counts = [len(n) for n in numbers]
    address = [np.divmod(n, e.episodes) for n, e in zip(numbers, experiments, strict=True)]
    cells = {cell.digest.hex(): None for e in spec.experiments for cell in e.cells}

    def of_cells(value: Callable[[Cell], Any], known: Iterable[str] | None = None) -> npt.NDArray[Any]:
        """A value of each episode's cell, or its number among `known` values."""
        number = None if known is None else {text: np.int32(i) for i, text in enumerate(known)}
        values = [
            np.array([value(cell) if number is None else number[value(cell)] for cell in e.cells])
            for e in spec.experiments
        ]
        parts = zip(shards, address, strict=True)
        return np.concatenate([values[shard.experiment][cell] for shard, (cell, _) in parts])

    dtype = _setpoint_type(spec)
    length = np.repeat([e.steps for e in experiments], counts)
    row_start = np.concatenate([np.arange(n) * e.steps for n, e in zip(counts, experiments, strict=True)])
    digests = [digest for w in written for digest in w.content.digests]
    arrays: list[pa.Array] = [
        arrow_array(np.concatenate([n + s.offset for s, n in zip(shards, numbers, strict=True)])),
        arrow_texts(of_cells(lambda cell: cell.digest.hex(), cells), list(cells)),
        arrow_array(np.concatenate([index for _, index in address])),
        arrow_array(of_cells(lambda cell: cell.setpoint).astype(dtype)),
        arrow_texts(of_cells(lambda cell: cell.label, spec.labels), spec.labels),
        _acting(spec, shards),
        _lists([shard.splits for shard in shards], counts),
        arrow_array(length),
        arrow_array(np.concatenate([w.content.returns for w in written])),
        arrow_array(np.repeat(np.array([shard.number for shard in shards], dtype=np.int32), counts)),
        arrow_array(row_start),
        arrow_array(row_start + length),
        pa.Array.from_buffers(pa.binary(32), len(digests), [None, pa.py_buffer(b"".join(digests))]),
    ]
    return pa.table(arrays, schema=episode_schema(dtype))


def _setpoint_type(spec: DatasetSpec) -> str:
    """That of the rows, to which the table is joined, unless it makes two setpoints one."""
    dtype = spec.experiments[0].output.dtype
    points = {cell.setpoint for experiment in spec.experiments for cell in experiment.cells}
    return dtype if len(set(np.array(list(points), dtype).tolist())) == len(points) else "float64"


def _acting(spec: DatasetSpec, shards: list[Shard]) -> pa.Array:
    """The policy that acts in each episode of shards; of a mixture, the one that was drawn for it."""
    known: dict[str, int] = {}
    parts = []
    for shard in shards:
        names, acting = acting_in(spec.experiments[shard.experiment], np.arange(shard.first, shard.stop))
        used = {place: known.setdefault(names[place], len(known)) for place in np.unique(acting).tolist()}
        codes = np.array([used.get(place, 0) for place in range(len(names))], dtype=np.int32)
        parts.append(codes[acting])
    return arrow_texts(np.concatenate(parts), list(known))


def _lists(lists: list[tuple[str, ...]], counts: list[int]) -> pa.ListArray:
    """A column that repeats each list of texts as often as its count says."""
    lengths = np.repeat([len(texts) for texts in lists], counts)
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    known = {text: i for i, text in enumerate(dict.fromkeys(text for texts in lists for text in texts))}
    numbers = [np.array([known[text] for text in texts], dtype=np.int64) for texts in lists]
    of = [np.tile(members, n) for members, n in zip(numbers, counts, strict=True)]
    texts = arrow_strings(list(known))
    if known:  # `take` imports pyarrow.compute, which takes 0.05 s
        texts = texts.take(arrow_array(np.concatenate(of)))
    return pa.ListArray.from_arrays(arrow_array(offsets), texts)


def statistics(spec: DatasetSpec, written: list[WrittenShard]) -> Statistics:
    """Make statistics.json: statistics of every float column, over all rows and over each declared split."""
    names = layout(spec.experiments[0]).names
    of_splits = {name: [w.content for w in written if name in w.shard.splits] for name in spec.declared}
    return Statistics(
        format="ibdata-statistics",
        version=1,
        all=_described(names, [w.content for w in written]),
        splits={name: _described(names, shards) for name, shards in of_splits.items()},
    )


def _described(names: Sequence[str], parts: Sequence[ShardSummary]) -> dict[str, Statistic]:
    total = reduce(merged, (part.moments for part in parts))
    return described(names, total, [part.sample for part in parts], [part.moments.rows for part in parts])
