"""Measure the time of each stage of a run alone."""

import io
import os
import tempfile

import numpy as np
import pyarrow.parquet as pq

from ibdata.dataset.digest import episode_digests
from ibdata.dataset.statistics import moments
from ibdata.experiment.plan import plan
from ibdata.numerics.random import Purpose, slots, uniforms
from ibdata.policies.actions import clip_and_round
from ibdata.simulation import kernel
from ibdata.simulation.episodes import NO_PAST
from ibdata.simulation.noise import NOISE_ROWS, standard_noise
from ibdata.simulation.rollout import CHUNK, LANES, Block, rollout
from ibdata.simulation.variables import columns, layout
from ibdata.writing.arrow import ROW_GROUP_ROWS, arrow_schema, arrow_table, digest_runs, writer_options
from measuring.timing import MILLION, Row, described, paired


def stages() -> list[Row]:
    """The time of each stage, in ns per transition."""
    return simulating() + writing()


def simulating() -> list[Row]:
    """The stages from random integers to columns, for one chunk of one block."""
    experiment = described(MILLION)
    block = Block(experiment, 0, LANES)
    n, count = LANES, CHUNK
    per = 1e9 / (n * count)
    raw, drift = block.episodes.integers(block.draw, block.lanes, 1, count)
    draws = block.policy.uniforms_per_step
    policy_raw = block.draw(block.lanes, Purpose.POLICY, 0, count, slots(draws))
    u, actions = np.empty((count, n, draws)), np.zeros((count, n, 3), dtype=np.float32)
    u_rows, action_rows = u.reshape(count * n, draws), actions.reshape(count * n, 3)
    seen, blank = np.empty((count * n, 0, 6), dtype=np.float32), np.zeros((NOISE_ROWS, n))
    places = layout(experiment)
    record = np.zeros((len(places.rows), count + 1, n), dtype=np.float32)
    table = np.empty((len(places.names), n * experiment.steps), dtype=np.float32)
    log_prob = np.zeros((count, n))

    def draw() -> None:
        block.episodes.integers(block.draw, block.lanes, 1, count)
        block.draw(block.lanes, Purpose.POLICY, 0, count, slots(draws))

    def policy() -> None:
        uniforms(policy_raw, u)
        clip_and_round(np.asarray(block.policy.act(seen, u_rows)), action_rows)
        block.policy.log_prob(seen, action_rows)

    def noise() -> None:
        for t in range(count):
            standard_noise(raw[t], blank)

    def step() -> None:
        block.episodes.advance(block.state, actions, raw, drift, NO_PAST, record, places.rows, 1)

    def scatter_columns() -> None:
        kernel.scatter_columns(
            record, actions, log_prob, places.sources, places.first_action, places.log_prob, table, 0,
            count, experiment.steps,
        )  # fmt: skip

    parts = paired(draw, policy, noise, step, scatter_columns)
    names = (
        "Philox integers",
        "policy and its density",
        "noise from integers",
        "noise, step, record",
        "record into columns",
    )
    return [(name, f"{seconds * per:.0f} ns", "", "") for name, seconds in zip(names, parts, strict=True)]


def writing() -> list[Row]:
    """The stages from columns to a file on the disk, for a million rows."""
    experiment = described(MILLION)
    (shard,) = plan(experiment)
    floats = rollout(experiment, 0, shard.stop)
    made = arrow_table(experiment, shard, floats)
    kinds = columns(experiment)

    def encode() -> bytes:
        out = io.BytesIO()
        with pq.ParquetWriter(out, arrow_schema(kinds), **writer_options(kinds)) as writer:
            writer.write_table(made, row_group_size=ROW_GROUP_ROWS)
        return out.getvalue()

    data = encode()

    def durable() -> None:
        with tempfile.TemporaryFile() as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())

    lengths = [experiment.steps] * shard.stop
    parts = paired(
        lambda: arrow_table(experiment, shard, floats),
        encode,
        lambda: episode_digests(digest_runs(experiment, shard, floats), lengths),
        lambda: moments(floats.table),
        durable,
    )
    names = (
        "columns into Arrow",
        "encode as Parquet",
        "content digests (SHA-256)",
        "moments",
        "write and fsync",
    )
    return [(name, f"{s * 1e9 / MILLION:.0f} ns", "", "") for name, s in zip(names, parts, strict=True)]
