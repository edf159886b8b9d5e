"""Measure the time of each stage of a run alone."""

import io
import os
import tempfile

import pyarrow.parquet as pq

from ibdata.dataset.statistics import moments
from ibdata.generation.pieces import ROW_GROUP_ROWS, Piece, arrow_schema, writer_options
from ibdata.plan.columns import columns
from ibdata.plan.dataset_spec import DatasetSpec
from ibdata.plan.rollout import rollout
from measuring.timing import MILLION, Row, described, paired


def stages() -> list[Row]:
    """The time of each stage from the simulation to a file on the disk, in ns per transition."""
    experiment = described(MILLION)
    (shard,) = DatasetSpec.of(experiment).shards
    piece = Piece(experiment, shard, rollout(experiment, 0, shard.stop))
    rows = piece.arrow_table()
    kinds = columns(experiment)

    def encode() -> bytes:
        out = io.BytesIO()
        with pq.ParquetWriter(out, arrow_schema(kinds), **writer_options(kinds)) as writer:
            writer.write_table(rows, row_group_size=ROW_GROUP_ROWS)
        return out.getvalue()

    data = encode()

    def durable() -> None:
        with tempfile.TemporaryFile() as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())

    calls = {
        "simulate": lambda: rollout(experiment, 0, shard.stop),
        "columns into Arrow": piece.arrow_table,
        "encode as Parquet": encode,
        "content digests (SHA-256)": piece.digests,
        "moments": lambda: moments(piece.floats.table),
        "write and fsync": durable,
    }
    parts = paired(*calls.values())
    return [Row(name, f"{1e9 * s / MILLION:.0f} ns") for name, s in zip(calls, parts, strict=True)]
