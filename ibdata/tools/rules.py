"""The rules for the rows of a dataset; each yields the columns that break it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from ibdata._numerics.arrays import Array
from ibdata.dataset.tabular import Table, Tabular
from ibdata.dynamics.setpoint import D_G, D_H, D_V
from ibdata.errors import DatasetError
from ibdata.experiment import Experiment
from ibdata.generation.pieces import index_columns, policy_numbers
from ibdata.plan.columns import Column
from ibdata.plan.dataset_spec import Shard
from ibdata.plan.rollout import expert_actions, log_densities
from ibdata.policies.user_object import UserObject


class Problem(NamedTuple):
    """A broken rule.

    Attributes:
        path: the file.
        row: the row of the file; None for what is not of one row.
        rule: the name of the rule.
        message: what was found and what was expected.
    """

    path: str
    row: int | None
    rule: str
    message: str

    @classmethod
    def of(cls, error: DatasetError, path: str, file: str, rule: str) -> Problem:
        """The problem that an error describes, without the name of the file in its message."""
        message = re.sub("[,;] see ibdata validate", "", str(error).removeprefix(f"{file}: "))
        return cls(path, None, rule, message)

    def __str__(self) -> str:
        row = "" if self.row is None else f": row {self.row}"
        return f"{self.path}{row}: {self.rule}: {self.message}"


class Findings(Tabular, list[Problem]):
    """The problems of a dataset: a list of `Problem` that shows as a table; empty if there are none."""

    def tables(self) -> list[Table]:
        """The problems, a row each."""
        return [Table(Problem._fields, self, () if self else ["no problems"])]


class Broken(NamedTuple):
    """The first row in which a column breaks a rule, what is wrong there, and the number of such rows."""

    row: int
    column: str
    message: str
    rows: int


Found = Iterator[Broken]


class Rows(NamedTuple):
    """Consecutive whole episodes of a shard."""

    experiment: Experiment
    episodes: Shard
    described: list[Column]
    columns: dict[str, Array]  # (rows,) each; a policy is the number of its label in the experiment
    ranges: dict[str, tuple[float, float]]  # least and greatest value of each float column that is finite

    def stack(self, role: str) -> Array:
        """The columns with a role, as float32 (episodes, steps, columns)."""
        columns = [self.columns[column.name] for column in self.described if column.role == role]
        return np.stack(columns, axis=1, dtype=np.float32).reshape(-1, self.experiment.steps, len(columns))

    def changed(self, before: str, after: str) -> Array:
        """The rows in which `before` is not what `after` is in the next row of the episode (k,)."""
        x, y = (self.columns[name].reshape(-1, self.experiment.steps) for name in (before, after))
        changes = np.flatnonzero(x[:, :-1] != y[:, 1:])
        rows: Array = changes + changes // max(1, self.experiment.steps - 1)
        return rows


def finite(rows: Rows) -> Found:
    """Every float is finite, except action_log_prob of a custom policy that does not know its density."""
    for column in rows.described:
        name = column.name
        if column.dtype.startswith("float") and column.role != "log_prob" and name not in rows.ranges:
            yield from _where(~np.isfinite(rows.columns[name]), name, rows, "a finite number")


def bounds(rows: Rows) -> Found:
    """Every number lies within the bounds of its column."""
    for column in rows.described:
        if column.dtype in ("bool", "string"):
            continue
        name, low, high = column.name, column.low, column.high
        least, greatest = rows.ranges.get(name, (-np.inf, np.inf))
        if low is not None and least < low:
            yield from _where(rows.columns[name] < low, name, rows, f"at least {low:g}")
        if high is not None and greatest > high:
            yield from _where(rows.columns[name] > high, name, rows, f"at most {high:g}")


def indices(rows: Rows) -> Found:
    """Whole episodes follow one another, and steps count from 0 within each."""
    texts = {"episode": "the episode of episodes.table", "step": "steps from 0 within each episode"}
    yield from _not_as_planned(rows, texts)


def flags(rows: Rows) -> Found:
    """terminated is never set; truncated is set exactly on the last row of each episode."""
    yield from _not_as_planned(rows, {"terminated": "false", "truncated": "true on last rows only"})


def policy(rows: Rows) -> Found:
    """Every row has the label of its episode's policy."""
    labels = rows.experiment.labels
    numbers = policy_numbers(rows.experiment, rows.episodes)
    stored, expected = rows.columns["policy"], np.repeat(numbers, rows.experiment.steps)
    broken = stored != expected
    if broken.any():
        row = int(np.argmax(broken))
        shown = labels[stored[row]] if stored[row] >= 0 else "another label"
        count = int(np.count_nonzero(broken))
        yield Broken(row, "policy", f"found {shown}, expected {labels[expected[row]]}", count)


def continuity(rows: Rows) -> Found:
    """The values at t + 1 in one row are those at t in the next row of the episode."""
    for column in rows.described:
        if column.role in ("next_observation", "next_latent"):
            wrong = rows.changed(column.name, column.name.removeprefix("next_"))
            yield from _at(wrong, column.name, rows, "the next row's value at t")


def reward(rows: Rows) -> Found:
    """reward = -c - 3 f of the next observation, up to rounding in float32."""
    c, f, r = (
        rows.columns[name].astype(np.float64)
        for name in ("next_obs_consumption", "next_obs_fatigue", "reward")
    )
    tolerance = 2.0**-23 * (np.abs(c) + 3.0 * np.abs(f) + np.abs(r))
    yield from _where(
        np.abs(r + c + 3.0 * f) > tolerance, "reward", rows, "-consumption - 3 fatigue at t + 1"
    )


def setpoint(rows: Rows) -> Found:
    """A constant setpoint is that of the episode's cell."""
    experiment = rows.experiment
    if experiment.drifting:
        return
    cells = np.arange(rows.episodes.first, rows.episodes.stop) // experiment.episodes
    low = int(cells[0])
    known = np.array([cell.setpoint for cell in experiment.cells[low : int(cells[-1]) + 1]])
    expected = np.repeat(known[cells - low], experiment.steps).astype(experiment.output.dtype)
    for name in ("obs_setpoint", "next_obs_setpoint"):
        yield from _where(rows.columns[name] != expected, name, rows, "the episode's setpoint")


def steering(rows: Rows) -> Found:
    """Velocity, gain and shift follow from the action (Hein et al. 2017, Eqs. 2 to 4)."""
    # The largest difference that rounding to the stored type can make to values in [0, 100].
    tolerance = 2.0**-16 if rows.experiment.output.dtype == "float32" else 2.0**-44
    for name, size in (("velocity", D_V), ("gain", D_G), ("shift", D_H)):
        x, action, after = (
            rows.columns[column].astype(np.float64)
            for column in (f"obs_{name}", f"act_{name}", f"next_obs_{name}")
        )
        wrong = np.abs(np.clip(x + size * action, 0.0, 100.0) - after) > tolerance
        yield from _where(wrong, f"next_obs_{name}", rows, f"the value that follows from act_{name}")


def shift_register(rows: Rows) -> Found:
    """The operational cost of k steps ago is that of k + 1 steps ago in the next row."""
    if "latent_theta_1" not in rows.columns:
        return
    for lag in range(2, 10):
        before, name = (f"latent_theta_{k}" for k in (lag - 1, lag))
        yield from _at(rows.changed(before, name) + 1, name, rows, f"{before} of the row before")


def density(rows: Rows) -> Found:
    """action_log_prob is the log density of the action under the policy; custom policies are not asked."""
    experiment, steps, first = rows.experiment, rows.experiment.steps, rows.episodes.first
    observations, actions = rows.stack("observation"), rows.stack("action")
    policies = policy_numbers(experiment, rows.episodes)
    cuts = [0, *(np.flatnonzero(np.diff(policies)) + 1).tolist(), len(policies)]
    wrong = np.zeros(len(rows.columns["step"]), dtype=np.bool_)
    for low, high in pairwise(cuts):
        behaviour = experiment.policies[policies[low]]
        if not any(behaviour.everywhere(UserObject)):
            stored = rows.columns["action_log_prob"][low * steps : high * steps]
            known = log_densities(
                experiment, first + low, first + high, observations[low:high], actions[low:high]
            )
            expected = known.ravel().astype(stored.dtype)
            odd = np.flatnonzero(stored != expected)
            far = ~np.isclose(stored[odd], expected[odd], rtol=1e-6, atol=1e-6, equal_nan=True)
            wrong[low * steps + odd[far]] = True
    yield from _where(wrong, "action_log_prob", rows, "the policy's log density")


def expert_action(rows: Rows) -> Found:
    """The expert's action is what the expert does at the observations up to the row."""
    if not rows.experiment.output.expert_action:
        return
    first, stop = rows.episodes.first, rows.episodes.stop
    stored, seen, acted = (rows.stack(role) for role in ("expert_action", "observation", "action"))
    wrong = stored != expert_actions(rows.experiment, first, stop, seen, acted)
    names = [column.name for column in rows.described if column.role == "expert_action"]
    for i, name in enumerate(names):
        yield from _where(wrong[..., i].ravel(), name, rows, "the expert's action")


RULES: dict[str, Callable[[Rows], Found]] = {
    rule.__name__.replace("_", " "): rule
    for rule in (
        finite, bounds, indices, flags, policy, continuity, reward, setpoint, steering, shift_register,
        density, expert_action,
    )
}  # fmt: skip


def nulls(batch: pa.RecordBatch) -> Found:
    """No value is missing."""
    for name, column in zip(batch.schema.names, batch.columns, strict=True):
        if column.null_count:
            row = int(np.argmax(column.is_null().to_numpy(zero_copy_only=False)))
            yield Broken(row, name, f"{name}: found null, expected a value", column.null_count)


def _not_as_planned(rows: Rows, texts: Mapping[str, str]) -> Found:
    """The first row of each of these columns that has other values than its text says."""
    expected = index_columns(rows.experiment, rows.episodes)
    for name, text in texts.items():
        yield from _where(rows.columns[name] != expected[name], name, rows, text)


def _where(broken: Array, name: str, rows: Rows, expected: str) -> Found:
    """The first row in which a column breaks a rule, and the number of such rows."""
    return _at(np.flatnonzero(broken), name, rows, expected)


def _at(broken: Array, name: str, rows: Rows, expected: str) -> Found:
    """As `_where`, given the numbers of the rows."""
    if len(broken):
        row = int(broken[0])
        message = f"{name}: found {rows.columns[name][row]}, expected {expected}"
        yield Broken(row, name, message, len(broken))
