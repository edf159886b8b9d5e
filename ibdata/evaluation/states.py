"""The exact states behind the rows of a dataset, which are simulated again and compared with the rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from ibdata._numerics.arguments import public
from ibdata._numerics.arrays import Float32s, Ints
from ibdata._simulation.carry import Carry, begin
from ibdata._simulation.episodes import FloatTable
from ibdata._simulation.unroll import unroll
from ibdata.dataset.dataset import Place, whole_dataset
from ibdata.dataset.episodes import BLOCK_ROWS
from ibdata.dataset.selection import numbers_within, whole_numbers
from ibdata.dataset.stored import Stored
from ibdata.dynamics import State
from ibdata.errors import DatasetError, UsageError, excerpt
from ibdata.experiment import Experiment
from ibdata.generation.finish import refuse_other_plan
from ibdata.plan.columns import layout
from ibdata.plan.dataset_spec import DatasetSpec, declared_spec
from ibdata.plan.rollout import PART_ROWS, episodes_of, write_columns
from ibdata.policies import Policy
from ibdata.policies.baselines import Constant


class Addresses:
    """The addresses of a dataset's episodes. Raises DatasetError if this ibdata makes other episodes."""

    def __init__(self, stored: Stored, spec: DatasetSpec | None = None) -> None:
        self.stored, self._spec = stored, spec or declared_spec(stored)
        refuse_other_plan(self._spec, stored.manifest)
        names = ("length", "shard", "row_start")
        self.lengths, self.shards, self.starts = (stored.episodes[name].to_numpy() for name in names)

    def episodes(self, numbers: Any) -> Ints:
        """Numbers of episodes as an array (n,). Raises UsageError if the dataset has no such episode."""
        return numbers_within("episode", numbers, len(self.lengths))

    def by_experiment(self, episodes: Ints) -> Iterator[tuple[Experiment, Ints, Ints]]:
        """Group episodes (n,): yield an experiment, and the positions and numbers in it of its episodes."""
        shards = [self._spec.shards[i] for i in self.shards[episodes].tolist()]
        experiments = np.array([shard.experiment for shard in shards])
        offsets = np.array([shard.offset for shard in shards])
        for i in np.unique(experiments).tolist():
            positions = np.flatnonzero(experiments == i)
            yield self._spec.experiments[i], positions, episodes[positions] - offsets[positions]


WATCHER = Constant()  # a policy that is never asked, where all actions are given


@public
def state_at(ds: Place, rows: Any) -> State:
    """The exact states from which rows of a dataset began.

    The episodes are simulated again from the addresses of their random numbers, with the actions in the rows.
    So no policy runs, and the numbers are float64 whatever the dataset stores. All rows up to and including
    the given ones are compared with what is simulated.

    Args:
        ds: The dataset, or its folder or URL.
        rows: One of these: the tuple `(episode, step)`, each a number or several (n,); an array of pairs of
            them (n, 2); one of the numbers of n rows, counted from 0 in the order of `ds.to_pandas()`; or a
            table with the columns `episode` and `step`, such as some rows of `ds.to_pandas()`. Lists are
            arrays, but not [3, 10], which might be (3, 10).

    Returns:
        The state of n lanes before the rows' actions; `state.fatigue`, for example, is an
        array (n,). `ibdata.dynamics.step` and `set_state` of the Gymnasium environment take it.

    Raises:
        UsageError: There is no such row.
        DatasetError: The rows are damaged, or this ibdata cannot simulate them again.
    """
    source = Replayable(whole_dataset(ds).stored)
    episodes, steps = source.episodes_and_steps(rows)
    return source.carries_at(episodes, steps).state


class Batch(NamedTuple):
    """m episodes of an experiment, and n rows of them that are wanted."""

    experiment: Experiment
    numbers: Ints  # (m,) of the episodes in the experiment
    episodes: Ints  # (m,) their numbers in the dataset
    lanes: Ints  # (n,) the position of each row's episode among the m
    steps: Ints  # (n,) of the rows

    @property
    def counts(self) -> Ints:
        """How many steps of each episode there are up to its last wanted row, (m,)."""
        counts = np.zeros(len(self.episodes), dtype=np.int64)
        np.maximum.at(counts, self.lanes, self.steps + 1)
        return counts


class Replayable(Addresses):
    """A dataset whose rows can be simulated again. Raises DatasetError if this ibdata cannot do that."""

    def episodes_and_steps(self, rows: Any) -> tuple[Ints, Ints]:
        """Episodes and steps (n,) of rows as `state_at` takes them. Raises UsageError if there is none."""
        episodes, steps = self._episodes_and_steps(rows)
        if not len(episodes):
            raise UsageError("rows: found no row, expected at least one")
        return episodes, steps

    def _episodes_and_steps(self, rows: Any) -> tuple[Ints, Ints]:
        if isinstance(rows, Mapping) or hasattr(rows, "columns"):
            try:
                return self._pairs(rows["episode"], rows["step"])
            except KeyError as error:
                expected = "expected columns episode, step"
                raise UsageError(f"rows: found a table without {error}, {expected}") from None
        if isinstance(rows, tuple):
            is_ambiguous = len(rows) != 2 or all(isinstance(x, tuple) and len(x) == 2 for x in rows)
        else:
            is_ambiguous = isinstance(rows, list) and len(rows) == 2 and np.ndim(rows) == 1
        if is_ambiguous:
            expected = "(episode, step), or an array of pairs of them (n, 2), or of numbers of rows"
            raise UsageError(f"rows: found {excerpt(rows)}, expected {expected}")
        if isinstance(rows, tuple):
            return self._pairs(*rows)
        if np.ndim(rows) == 2 and np.shape(rows)[1] == 2:
            return self._pairs(*np.asarray(rows).T)
        ends = np.cumsum(self.lengths)
        numbers = numbers_within("row", rows, int(ends[-1]))
        episodes = np.searchsorted(ends, numbers, side="right")
        return episodes, numbers - (ends - self.lengths)[episodes]

    def _pairs(self, episode: Any, step: Any) -> tuple[Ints, Ints]:
        """Episodes and steps as arrays (n,)."""
        episodes, steps = self.episodes(episode), whole_numbers("step", step)
        if len(episodes) != len(steps) and min(len(episodes), len(steps)) != 1:
            raise UsageError(
                f"episode and step: found {len(episodes)} and {len(steps)} numbers, expected equally many"
            )
        episodes, steps = np.broadcast_arrays(episodes, steps)
        wrong = (steps < 0) | (steps >= self.lengths[episodes])
        if wrong.any():
            i = int(np.argmax(wrong))
            last = self.lengths[episodes[i]] - 1
            raise UsageError(
                f"step: found {steps[i]}, expected one of 0 to {last}, the steps of episode {episodes[i]}"
            )
        return episodes, steps

    def carries_at(self, episodes: Ints, steps: Ints, policy: Policy = WATCHER) -> Carry:
        """Simulate up to rows (n,), which a policy watches; DatasetError if they differ from the stored."""
        out = Carry.at(State.zeros(len(episodes)), policy.needs)
        different = np.unique(episodes)
        most = max(1, PART_ROWS // (int(steps.max()) + 1))
        for experiment, positions, numbers in self.by_experiment(different):
            for i in range(0, len(positions), most):
                batch_episodes = different[positions[i : i + most]]
                rows = np.flatnonzero(np.isin(episodes, batch_episodes))
                lanes = np.searchsorted(batch_episodes, episodes[rows])
                batch = Batch(experiment, numbers[i : i + most], batch_episodes, lanes, steps[rows])
                out.put(rows, self._compared(batch, policy))
        return out

    def _compared(self, batch: Batch, policy: Policy) -> Carry:
        """Simulate up to the rows of a batch, and compare them with the stored ones."""
        columns, counts = layout(batch.experiment), batch.counts
        names = list(columns.names[: columns.log_prob])
        stored = self.columns(names, batch.episodes, counts, np.dtype(batch.experiment.output.dtype))
        actions = stored[columns.first_action : columns.first_action + 3].transpose(2, 1, 0)
        invalid = ~(np.abs(actions) <= 1.0)
        if invalid.any():
            step, lane, _ = np.argwhere(invalid)[0]
            raise DatasetError(
                f"{self.stored.name}: episode {batch.episodes[lane]}: step {step}: found the action "
                f"{actions[step, lane].tolist()}, expected numbers in [-1, 1]; see ibdata validate"
            )
        carry, table = revisit(batch, policy, np.ascontiguousarray(actions, dtype=np.float32))
        simulated = table[: columns.log_prob].reshape(stored.shape)
        differing = (stored != simulated) & (np.arange(len(actions)) < counts[:, None])
        if differing.any():
            lane, step, column = np.argwhere(differing.transpose(1, 2, 0))[0]
            found, expected = (float(values[column, lane, step]) for values in (stored, simulated))
            raise DatasetError(
                f"{self.stored.name}: episode {batch.episodes[lane]}: step {step}: {names[column]}: found "
                f"{found!r}, expected {expected!r}, which the simulation gives; see ibdata validate"
            )
        return carry

    def columns(self, names: list[str], episodes: Ints, counts: Ints, dtype: np.dtype[Any]) -> FloatTable:
        """The first rows of episodes, as many as `counts` says, (columns, episodes, rows); the rest is 0."""
        steps = np.arange(int(counts.max()))
        rows = np.where(steps < counts[:, None], self.starts[episodes][:, None] + steps, -1)
        out = np.zeros((len(names), *rows.shape), dtype=dtype)
        shards = self.shards[episodes]
        for shard in np.unique(shards).tolist():
            here = (rows >= 0) & (shards == shard)[:, None]
            first, stop = int(rows[here].min()), int(rows[here].max()) + 1
            for batch in self.stored.batches(shard, names, BLOCK_ROWS, first, stop):
                inside = here & (rows >= first) & (rows < first + batch.num_rows)
                for into, column in zip(out, batch.columns, strict=True):
                    into[inside] = column.to_numpy(zero_copy_only=False)[rows[inside] - first]
                first += batch.num_rows
        return out


def revisit(batch: Batch, policy: Policy, actions: Float32s) -> tuple[Carry, FloatTable]:
    """Play the recorded actions of episodes, side by side, which a policy watches.

    A policy with a memory is asked at every step, with the random numbers of the episode's own policy. So if
    it is that policy, it remembers what it remembered then.

    Args:
        batch: the episodes, and the rows that are wanted.
        policy: the policy that watches.
        actions: the recorded actions (steps, m, 3).

    Returns:
        Where the episodes are before the wanted rows (n,), and the columns of all rows (columns, m · steps),
        in the order of `rollout`; the columns from the log density on hold nothing.
    """
    episodes = episodes_of(batch.experiment, batch.numbers).played_by(policy, number=batch.episodes)
    steps, columns = len(actions), layout(batch.experiment)
    table = np.empty((len(columns.names), len(episodes) * steps), dtype=batch.experiment.output.dtype)
    carry = begin(episodes)
    before_rows = carry.take(batch.lanes)  # of the right shape; those at later steps follow
    for block in unroll(episodes, carry, columns.rows, steps, recorded=actions, stops=batch.steps.tolist()):
        write_columns(block, columns, table, 0, steps)
        here = np.flatnonzero(batch.steps == block.stop)
        before_rows.put(here, carry.take(batch.lanes[here]))
    return before_rows, table
