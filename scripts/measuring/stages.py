"""Measure the time of each stage of a run alone."""

import io
import os
import tempfile
from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from ibdata.dataset.digest import episode_digests
from ibdata.dataset.statistics import moments
from ibdata.experiment.columns import columns, layout
from ibdata.experiment.plan import plan
from ibdata.experiment.rollout import lanes_of, rollout
from ibdata.numerics.random import Purpose, slots, uniforms
from ibdata.policies.actions import clip_and_round
from ibdata.policies.base import at_start
from ibdata.simulation import kernel
from ibdata.simulation.driver import CHUNK, LANES, Run
from ibdata.simulation.noise import NOISE_ROWS, standard_noise
from ibdata.simulation.world import NO_PAST
from ibdata.writing.arrow import ROW_GROUP_ROWS, arrow_schema, arrow_table, digest_runs, writer_options
from measuring.timing import MILLION, Row, described, paired


def stages() -> list[Row]:
    """The time of each stage, in ns per transition."""
    return simulating() + writing()


def simulating() -> list[Row]:
    """The stages from random integers to columns, for one chunk of one block."""
    experiment = described(MILLION)
    run = Run(experiment.world, lanes_of(experiment, np.arange(LANES)))
    acting, numbers = run.lanes.policy, run.everyone
    n, count = LANES, CHUNK
    raw, drift = run.world.integers(run.lanes.draw, numbers, 1, count)
    draws = run.needs.step_draws
    policy_raw = run.lanes.draw(numbers, Purpose.POLICY, 0, count, slots(draws))
    u, actions = np.empty((count, n, draws)), np.zeros((count, n, 3), dtype=np.float32)
    u_rows, action_rows = u.reshape(count * n, draws), actions.reshape(count * n, 3)
    given = at_start(np.empty((count * n, 0, 6), dtype=np.float32), run.needs, u_rows)
    blank = np.zeros((NOISE_ROWS, n))
    places = layout(experiment)
    record = np.zeros((len(places.rows), count + 1, n))
    table = np.empty((len(places.names), n * experiment.steps), dtype=np.float32)
    log_prob = np.zeros((count, n))

    def draw() -> None:
        run.world.integers(run.lanes.draw, numbers, 1, count)
        run.lanes.draw(numbers, Purpose.POLICY, 0, count, slots(draws))

    def policy() -> None:
        uniforms(policy_raw, u)
        clip_and_round(np.asarray(acting.decide(given).actions), action_rows)
        acting.log_density(given, action_rows)

    def noise() -> None:
        for t in range(count):
            standard_noise(raw[t], blank)

    def step() -> None:
        run.world.advance(run.state, actions, raw, drift, NO_PAST, record, places.rows, 1)

    def scatter_columns() -> None:
        kernel.scatter_columns(
            record, actions, log_prob, places.sources, places.first_action, places.log_prob, table, 0,
            count, experiment.steps,
        )  # fmt: skip

    calls = {
        "Philox integers": draw,
        "policy and its density": policy,
        "noise from integers": noise,
        "noise, step, record": step,
        "record into columns": scatter_columns,
    }
    return timed_rows(calls, n * count)


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
    calls = {
        "columns into Arrow": lambda: arrow_table(experiment, shard, floats),
        "encode as Parquet": encode,
        "content digests (SHA-256)": lambda: episode_digests(digest_runs(experiment, shard, floats), lengths),
        "moments": lambda: moments(floats.table),
        "write and fsync": durable,
    }
    return timed_rows(calls, MILLION)


def timed_rows(calls: dict[str, Callable[[], Any]], transitions: int) -> list[Row]:
    """A row with the time of each call a transition."""
    parts = paired(*calls.values())
    return [Row(name, f"{1e9 * s / transitions:.0f} ns") for name, s in zip(calls, parts, strict=True)]
