"""The files of `meta/`: what a dataset is, in JSON, YAML and one Parquet table."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ibdata.columns import columns
from ibdata.dataset.schema import arrow_array, arrow_strings, arrow_texts
from ibdata.dataset.shard import Written
from ibdata.dataset.statistics import described, merged
from ibdata.experiment import Experiment

FORMAT = "ibdata-dataset"
VERSION = 1

EPISODES = pa.schema(
    [
        ("episode", pa.int64()),
        ("cell", pa.dictionary(pa.int32(), pa.string())),
        ("index", pa.int64()),
        ("setpoint", pa.float64()),
        ("policy", pa.dictionary(pa.int32(), pa.string())),
        ("splits", pa.list_(pa.string())),
        ("length", pa.int64()),
        ("return", pa.float64()),
        ("shard", pa.int32()),
        ("row_start", pa.int64()),
        ("row_stop", pa.int64()),
        ("digest", pa.binary(32)),
    ]
)


def as_json(data: Any) -> bytes:
    """JSON as ibdata's files hold it: indented, without NaN, ending in a newline."""
    return (json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def info(experiment: Experiment, written: list[Written]) -> dict[str, Any]:
    """info.json: columns with their meaning, groups of columns, counts, splits."""
    described_columns = [c._asdict() for c in columns(experiment)]
    groups: dict[str, list[str]] = {}
    for column in described_columns:
        groups.setdefault(column["role"], []).append(column["name"])
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": experiment.name,
        "dynamics": experiment.plain()["dynamics"],
        "drifting": experiment.drifting,
        "start": experiment.plain()["start"],
        "counts": {
            "rows": experiment.rows,
            "episodes": len(experiment.cells) * experiment.episodes,
            "steps": experiment.steps,
            "cells": len(experiment.cells),
            "shards": len(written),
            "data_bytes": sum(w.entry.bytes for w in written),
        },
        "splits": splits(experiment, written),
        "groups": groups,
        "columns": described_columns,
    }


def splits(experiment: Experiment, written: Iterable[Written]) -> dict[str, dict[str, Any]]:
    """Episodes, rows and files of each declared split; every one is made of whole files."""
    out: dict[str, dict[str, Any]] = {
        name: {"episodes": 0, "rows": 0, "files": []} for name in experiment.splits
    }
    for w in written:
        for name in w.shard.splits:
            episodes = w.shard.stop - w.shard.first
            out[name]["episodes"] += episodes
            out[name]["rows"] += episodes * experiment.steps
            out[name]["files"].append(w.shard.file)
    return out


def episodes_parquet(experiment: Experiment, written: list[Written]) -> bytes:
    """episodes.parquet: a row an episode."""
    first = np.concatenate([np.arange(w.shard.first, w.shard.stop) for w in written])
    cell, index = np.divmod(first, experiment.episodes)
    cells = experiment.cells
    counts = [w.shard.stop - w.shard.first for w in written]
    row_start = np.concatenate([np.arange(n) * experiment.steps for n in counts])
    arrays: list[pa.Array] = [
        arrow_array(first),
        arrow_texts(cell.astype(np.int32), [c.digest.hex() for c in cells]),
        arrow_array(index),
        arrow_array(np.array([c.setpoint for c in cells])[cell]),
        arrow_texts((cell // (len(cells) // len(experiment.policies))).astype(np.int32), experiment.labels),
        _lists([w.shard.splits for w in written], counts),
        arrow_array(np.full(len(first), experiment.steps, dtype=np.int64)),
        arrow_array(np.concatenate([w.content.returns for w in written])),
        arrow_array(np.repeat(np.array([w.shard.number for w in written], dtype=np.int32), counts)),
        arrow_array(row_start),
        arrow_array(row_start + experiment.steps),
        pa.Array.from_buffers(
            pa.binary(32),
            len(first),
            [None, pa.py_buffer(b"".join(d for w in written for d in w.content.digests))],
        ),
    ]
    out = io.BytesIO()
    pq.write_table(pa.table(arrays, schema=EPISODES), out, compression="zstd", write_page_checksum=True)
    return out.getvalue()


def _lists(lists: list[tuple[str, ...]], counts: list[int]) -> pa.ListArray:
    """Each list of texts, as often as its count says."""
    lengths = np.repeat([len(texts) for texts in lists], counts)
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    texts = [text for texts, n in zip(lists, counts, strict=True) for _ in range(n) for text in texts]
    return pa.ListArray.from_arrays(arrow_array(offsets), arrow_strings(texts))


def stats(experiment: Experiment, names: tuple[str, ...], written: list[Written]) -> dict[str, Any]:
    """stats.json: statistics of every float column, over all rows and over each split."""
    return {
        "format": "ibdata-stats",
        "version": VERSION,
        "all": _described(names, written),
        "splits": {
            name: _described(names, [w for w in written if name in w.shard.splits])
            for name in experiment.splits
        },
    }


def _described(names: tuple[str, ...], written: list[Written]) -> dict[str, Any]:
    parts = written[0].content.moments
    for w in written[1:]:
        parts = merged(parts, w.content.moments)
    samples = [w.content.sample for w in written]
    return described(names, parts, samples, [w.content.moments.rows for w in written])
