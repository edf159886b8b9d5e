"""Hypothetical rollouts: sequences of actions played from any state, with fresh or with recorded noise."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arguments import public
from ibdata._numerics.random import Purpose, Raw, stream_key
from ibdata._simulation.carry import Carry, begin
from ibdata._simulation.episodes import Episodes, Float32s, Ints, World, observed_rows, record_rows, values_of
from ibdata._simulation.unroll import LANES, unroll
from ibdata._system.memory import refuse_too_much
from ibdata.dataset.dataset import whole_dataset
from ibdata.dynamics import State
from ibdata.dynamics.state import checked_state
from ibdata.errors import UsageError, excerpt
from ibdata.evaluation.play import rewarded, rewards_of
from ibdata.evaluation.states import WATCHER, Source
from ibdata.experiment.rollout import episodes_of
from ibdata.experiment.scenario import form_digest, scenario_of
from ibdata.policies.distributions import finite_actions
from ibdata.views.options import View, ViewOptions, Window, view_of
from ibdata.views.rewards import scaled

RECORDED = "recorded"


class Rollouts(NamedTuple):
    """What n starts, k sequences of h actions and some samples of the noise gave.

    `state` has n · k · samples lanes, in the order of the arrays.
    """

    rewards: Float32s  # (n, k, samples, h)
    observations: Float32s  # (n, k, samples, h, columns), after each action
    state: State
    world: World | None  # in which further rollouts go on; None if the starts had several dynamics
    steps: int  # played so far, after which the noise goes on


@dataclasses.dataclass(frozen=True, eq=False)
class Noisy(Episodes):
    """Episodes whose noise goes on from a step of their own; equal lanes of `unit` share it."""

    first_step: Ints  # (units,)
    unit: Ints  # (n,): which of the addresses (units,) a lane has

    def __len__(self) -> int:
        return len(self.unit)

    def draw(self, lanes: Ints, purpose: Purpose, step: int, steps: int, slots: int) -> Raw:
        """The integers (steps, slots, lanes) at the addresses of these lanes."""
        units, lane_units = np.unique(self.unit[lanes], return_inverse=True)
        out = np.empty((steps, slots, len(units)), dtype=np.uint64)
        for first in np.unique(self.first_step[units]).tolist():
            here = np.flatnonzero(self.first_step[units] == first)
            out[:, :, here] = super().draw(units[here], purpose, first + step, steps, slots)
        return out if len(units) == len(lanes) else out[:, :, lane_units]


@dataclasses.dataclass(frozen=True, eq=False)
class Begun:
    """m starts of one world: their numbers, where they are, and the addresses of their noise."""

    world: World
    numbers: Ints  # (m,), among all starts
    carry: Carry
    keys: Raw  # (m, 2)
    index: Ints  # (m,)
    first_step: Ints  # (m,)


@public
def rollouts(
    start: Any,
    actions: npt.ArrayLike,
    *,
    rows: Any = None,
    samples: int = 1,
    noise: int | str = 0,
    view: View = None,
) -> Rollouts:
    """Play sequences of actions from any state: what would have happened.

    The noise of a sample is the same for all k sequences from a start, so their differences are paired. It is
    independent between starts and between samples, and the same call gives the same bits.

    Args:
        start: The n starts. Either a dataset, its folder or URL, with `rows`; or a `State` of n lanes, as of
            `ibdata.state_at` or an environment's `state`, with the dynamics `siemens`, or ("paper", state);
            or the settings of one start for each setpoint, such as {"setpoint": 70, "start": "uniform",
            "dynamics": "paper"}; or earlier rollouts, which go on from all their lanes with further noise.
        actions: (k, h, 3) for all starts, or (n, k, h, 3); clipped to [-1, 1] and rounded to float32.
        rows: The rows of the dataset before whose actions the rollouts start, as in `state_at`.
        samples: How often each sequence is played, each time with other noise.
        noise: The seed of the noise; or "recorded", the noise of the dataset's own episodes. With it, the
            actions of a row give the row that follows, as float32, and other actions the counterfactual.
        view: What is observed and rewarded, as the options of a view (docs/views.md). Imperfections have
            their own seed.

    Returns:
        Rewards (n, k, samples, h), observations (n, k, samples, h, columns), and the last states.

    Raises:
        UsageError, ConfigError: An argument is invalid, or the dataset has no such row.
        DatasetError: The rows are damaged, or this ibdata cannot simulate them again.
    """
    options = view_of(view)
    if samples < 1:
        raise UsageError(f"samples: found {samples}, expected at least 1")
    if isinstance(noise, str) and (noise != RECORDED or rows is None or samples != 1):
        raise UsageError(
            f"noise: found {noise!r}, expected a seed, or 'recorded' with rows of a dataset and one sample"
        )
    if options.cost is not None:
        raise UsageError("view: found a cost, which rollouts do not return; leave it out")
    if not isinstance(noise, str) and noise < 0:
        raise UsageError(f"noise: found {noise}, expected a seed of at least 0")
    begun = list(_begun(start, rows, noise))
    n, drifting = sum(len(part.numbers) for part in begun), begun[0].world.drifting
    if any(part.world.drifting != drifting for part in begun):
        raise UsageError("rows: found constant and moving setpoints, expected rows of one kind")
    played = _applied(actions, n)
    k, h = played.shape[1:3]
    shape, columns = (n, k, samples, h), len(options.frame(drifting))
    lane = begun[0].carry.state.values[:, 0].nbytes + 4 * h * (1 + columns)
    refuse_too_much("samples", lane * n * k * samples)
    out = Rollouts(
        np.empty(shape, np.float32),
        np.empty((*shape, columns), np.float32),
        State.zeros(n * k * samples),
        begun[0].world if len({part.world.variant for part in begun}) == 1 else None,
        h + (start.steps if isinstance(start, Rollouts) else 0),
    )
    for part in begun:
        _play(part, played, samples, options, out)
    return out


def _begun(start: Any, rows: Any, noise: int | str) -> Iterator[Begun]:
    """The starts, those of one experiment together."""
    seed = 0 if isinstance(noise, str) else scenario_of(seed=noise).seed
    key = stream_key(seed, form_digest({"label": "rollout"}))
    dynamics, state = start if isinstance(start, tuple) and len(start) == 2 else ("siemens", start)
    if rows is not None:
        source = Source(whole_dataset(start).stored)
        episodes, steps = source.episodes_and_steps(rows)
        carry = source.carries_at(episodes, steps)
        for experiment, positions, inner in source.by_experiment(episodes):
            recorded, world = episodes_of(experiment, inner), experiment.scenario.world
            keys, index, first = recorded.keys, recorded.index, steps[positions]
            if noise != RECORDED:
                keys, index, first = np.tile(key, (len(inner), 1)), positions, np.zeros_like(positions)
            yield Begun(world, positions, carry.take(positions), keys, index, first)
        return
    first_step = 0
    if isinstance(start, Rollouts):
        if start.world is None:
            raise UsageError("start: found rollouts of several dynamics, expected those of one")
        world, first_step = start.world, start.steps
        carry = Carry.at(start.state, WATCHER.needs)
    elif isinstance(state, State):
        try:
            state = checked_state(state)
        except ValueError as error:
            raise UsageError(f"start: {str(error).removeprefix('step: ')}") from None
        moves = state.drift_left >= 0
        if not len(moves) or moves.any() != moves.all():
            raise UsageError("start: expected lanes that all have constant setpoints, or all moving ones")
        world = dataclasses.replace(scenario_of(dynamics=dynamics).world, drifting=bool(moves.any()))
        carry = Carry.at(state, WATCHER.needs)
    elif isinstance(start, Mapping):
        if unknown := {str(name) for name in start} - {"setpoint", "start", "dynamics"}:
            raise UsageError(f"start: found {min(unknown)}, expected setpoint, start and dynamics")
        scenario = scenario_of(**start)
        world, setpoints = scenario.world, np.array(scenario.points)
        lanes, keys = np.arange(len(setpoints)), np.tile(key, (len(setpoints), 1))
        carry = begin(Episodes(world, WATCHER, WATCHER.label, keys, keys, lanes, setpoints, lanes))
    else:
        raise UsageError(
            f"start: found {excerpt(start)}, expected a dataset with rows=, a State, or settings such as "
            "{'setpoint': 70}"
        )
    numbers = np.arange(carry.state.lanes)
    keys, first = np.tile(key, (len(numbers), 1)), np.full_like(numbers, first_step)
    yield Begun(world, numbers, carry, keys, numbers, first)


def _play(begun: Begun, actions: Float32s, samples: int, view: ViewOptions, out: Rollouts) -> None:
    """Play all sequences (n, k, h, 3) from some starts; those of a sample are neighbours, for their noise."""
    k, h, drifting = actions.shape[1], actions.shape[2], begun.world.drifting
    paid = record_rows(rewarded(dataclasses.replace(view, cost=None)))
    seen = observed_rows(view, drifting)
    total = len(begun.numbers) * samples * k
    for first in range(0, total, LANES):
        unit, sequence = np.divmod(np.arange(first, min(first + LANES, total)), k)
        units = np.arange(unit[0], unit[-1] + 1)  # a unit is a sample from a start, which has one noise
        of, sample = units // samples, unit % samples
        starts = begun.numbers[unit // samples]
        lanes = Noisy(
            begun.world, WATCHER, WATCHER.label,
            keys=begun.keys[of], policy_keys=begun.keys[of],
            index=begun.index[of] * samples + units % samples,
            setpoint=begun.carry.state.setpoint[of], number=starts,
            first_step=begun.first_step[of], unit=unit - unit[0],
        )  # fmt: skip
        carry = begun.carry.take(unit // samples)
        numbers = np.ravel_multi_index((starts, sequence, sample), out.rewards.shape[:3])
        window = Window(view, drifting, len(unit), 1) if view.imperfections or view.actions else None
        if window is not None:
            window.begin(lanes.lanes, values_of(carry.state, seen), starts * samples + sample)
        recorded = np.ascontiguousarray(actions[starts, sequence].transpose(1, 0, 2))
        for block in unroll(lanes, carry, np.concatenate([paid, seen]), h, recorded=recorded):
            here = (starts, sequence, sample, slice(block.first, block.stop))
            rewards = scaled(rewards_of(block.record[: len(paid)], view), view.reward_scale)
            out.rewards[here] = rewards.T
            clean = (block.record[len(paid) :, 1:].T + 0.0).astype(np.float32)  # (lanes, steps, columns)
            out.observations[here] = clean if window is None else _frames(window, clean, block.actions)
        out.state.put(numbers, carry.state)


def _frames(window: Window, clean: Float32s, actions: Float32s) -> Float32s:
    """The frames (lanes, steps, columns) that follow actions (steps, lanes, 3), from the true values."""
    frames, everyone = [], np.arange(len(clean))
    for t, taken in enumerate(actions):
        window.push(everyone, clean[:, t], taken)
        frames.append(window.frames[:, 0].copy())
    return np.stack(frames, axis=1)


def _applied(actions: npt.ArrayLike, n: int) -> Float32s:
    """Sequences of actions (n, k, h, 3), clipped and rounded. Raises UsageError if they are none."""
    sequences = finite_actions(actions)
    shape = () if sequences is None else sequences.shape
    if sequences is None or len(shape) not in (3, 4) or shape[:-3] not in ((), (n,)) or not sequences.size:
        raise UsageError(
            f"actions: found {excerpt(actions, 80)}, expected (k, h, 3) or ({n}, k, h, 3) finite numbers: "
            "sequences of changes of velocity, gain and shift in [-1, 1]"
        )
    return np.broadcast_to(sequences, (n, *shape[-3:]))
