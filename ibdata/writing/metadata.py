"""The files of `meta/`: what a dataset is, in JSON, YAML and one Parquet table."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from ibdata.dataset.episodes import SCHEMA as EPISODES
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.simulation.variables import Table, columns, layout
from ibdata.writing.arrow import arrow_array, arrow_strings, arrow_texts
from ibdata.writing.shard_writer import WrittenShard
from ibdata.writing.statistics import Moments, described, merged

FORMAT = "ibdata-dataset"
VERSION = 1


def as_json(data: Any) -> bytes:
    """JSON as ibdata's files hold it: indented, without NaN, ending in a newline."""
    return (json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def info(spec: DatasetSpec, written: list[WrittenShard]) -> dict[str, Any]:
    """info.json: columns with their meaning, groups of columns, counts, splits."""
    described_columns = [c.form() for c in columns(spec.experiments[0])]
    groups: dict[str, list[str]] = {}
    for column in described_columns:
        groups.setdefault(column["role"], []).append(column["name"])
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": spec.name,
        "dynamics": _common([e.plain()["dynamics"] for e in spec.experiments]),
        "drifting": spec.experiments[0].drifting,
        "start": _common([e.plain()["start"] for e in spec.experiments]),
        "counts": {
            "rows": spec.rows,
            "episodes": spec.episodes,
            "steps": _common([e.steps for e in spec.experiments]),
            "cells": len({cell.digest for e in spec.experiments for cell in e.cells}),
            "shards": len(written),
            "data_bytes": sum(w.entry.bytes for w in written),
        },
        "splits": splits(spec, written),
        "groups": groups,
        "columns": described_columns,
    }


def _common(values: list[Any]) -> Any:
    """The value that all have; null where they differ."""
    return values[0] if all(value == values[0] for value in values) else None


def splits(spec: DatasetSpec, written: Iterable[WrittenShard]) -> dict[str, dict[str, Any]]:
    """Episodes and rows of each split, and its files; null in place of those where it is not whole files."""
    out: dict[str, dict[str, Any]] = {
        **{name: {"episodes": 0, "rows": 0, "files": []} for name in spec.declared},
        **{name: {"episodes": 0, "rows": 0, "files": None} for name in spec.later},
    }
    for w in written:
        steps = spec.of_shard(w.shard).steps
        for name in w.shard.splits:
            out[name]["files"].append(w.entry.path)
        for first, stop, names in spec.runs(w.shard):
            for name in names:
                out[name]["episodes"] += stop - first
                out[name]["rows"] += (stop - first) * steps
    return out


def episodes_parquet(spec: DatasetSpec, written: list[WrittenShard]) -> bytes:
    """episodes.parquet: a row an episode."""
    out = io.BytesIO()
    table = episodes_table(spec, written)
    pq.write_table(table, out, compression="zstd", write_page_checksum=True)
    return out.getvalue()


def episodes_table(spec: DatasetSpec, written: list[WrittenShard]) -> pa.Table:
    """The table of episodes."""
    numbers = [np.arange(w.shard.first, w.shard.stop) for w in written]
    parts = [_cells(spec, w, n) for w, n in zip(written, numbers, strict=True)]
    lengths = [np.full(len(n), spec.of_shard(w.shard).steps) for w, n in zip(written, numbers, strict=True)]
    length, row_start = np.concatenate(lengths), np.concatenate([np.cumsum(x) - x for x in lengths])
    digests = [digest for w in written for digest in w.content.digests]
    runs = [run for w in written for run in spec.runs(w.shard)]
    cells = list(dict.fromkeys(cell.digest.hex() for e in spec.experiments for cell in e.cells))
    arrays: list[pa.Array] = [
        arrow_array(np.concatenate([n + w.shard.offset for w, n in zip(written, numbers, strict=True)])),
        _texts([part.cell for part in parts], cells),
        arrow_array(np.concatenate([part.number for part in parts])),
        arrow_array(np.concatenate([part.setpoint for part in parts])),
        _texts([part.policy for part in parts], spec.labels),
        _lists([names for *_, names in runs], [stop - first for first, stop, _ in runs]),
        arrow_array(length),
        arrow_array(np.concatenate([w.content.returns for w in written])),
        arrow_array(
            np.repeat(np.array([w.shard.number for w in written], dtype=np.int32), [len(n) for n in numbers])
        ),
        arrow_array(row_start),
        arrow_array(row_start + length),
        pa.Array.from_buffers(pa.binary(32), len(digests), [None, pa.py_buffer(b"".join(digests))]),
    ]
    return pa.table(arrays, schema=EPISODES)


class _Episodes(NamedTuple):
    """Cell, index in it, setpoint and policy of some episodes; texts as themselves and their numbers."""

    cell: tuple[list[str], npt.NDArray[np.int64]]
    number: npt.NDArray[np.int64]
    setpoint: npt.NDArray[np.float64]
    policy: tuple[list[str], npt.NDArray[np.int64]]


def _cells(spec: DatasetSpec, w: WrittenShard, numbers: npt.NDArray[np.int64]) -> _Episodes:
    experiment = spec.of_shard(w.shard)
    number, index = np.divmod(numbers, experiment.episodes)
    low, high = int(number[0]), int(number[-1]) + 1
    cells = experiment.cells[low:high]
    setpoints = np.array([cell.setpoint for cell in cells])[number - low]
    return _Episodes(
        ([cell.digest.hex() for cell in cells], number - low),
        index,
        setpoints,
        ([cell.label for cell in cells], number - low),
    )


def _texts(parts: list[tuple[list[str], npt.NDArray[np.int64]]], known: list[str]) -> pa.DictionaryArray:
    """Texts of which all are among those known."""
    number = {text: i for i, text in enumerate(known)}
    numbers = [np.array([number[text] for text in texts], dtype=np.int32)[of] for texts, of in parts]
    return arrow_texts(np.concatenate(numbers), known)


def _lists(lists: list[tuple[str, ...]], counts: list[int]) -> pa.ListArray:
    """Each list of texts, as often as its count says."""
    lengths = np.repeat([len(texts) for texts in lists], counts)
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    known = {text: i for i, text in enumerate(dict.fromkeys(text for texts in lists for text in texts))}
    numbers = [np.array([known[text] for text in texts], dtype=np.int64) for texts in lists]
    of = [np.tile(own, n) for own, n in zip(numbers, counts, strict=True)]
    texts = arrow_strings(list(known)).take(arrow_array(np.concatenate(of)))
    return pa.ListArray.from_arrays(arrow_array(offsets), texts)


def stats(spec: DatasetSpec, written: list[WrittenShard]) -> dict[str, Any]:
    """stats.json: statistics of every float column, over all rows and over each split."""
    names = layout(spec.experiments[0]).names
    parts = [(w.content.moments, [w.content.sample]) for w in written]
    declared = {
        name: [part for part, w in zip(parts, written, strict=True) if name in w.shard.splits]
        for name in spec.declared
    }
    later = {
        name: [w.content.labelled[name] for w in written if name in w.content.labelled] for name in spec.later
    }
    return {
        "format": "ibdata-stats",
        "version": VERSION,
        "all": _described(names, parts),
        "splits": {name: _described(names, own) for name, own in {**declared, **later}.items()},
    }


def _described(names: tuple[str, ...], parts: list[tuple[Moments, list[Table]]]) -> dict[str, Any]:
    total = reduce(merged, (part for part, _ in parts))
    samples = [np.concatenate(own, axis=1) for _, own in parts]
    return described(names, total, samples, [part.rows for part, _ in parts])
