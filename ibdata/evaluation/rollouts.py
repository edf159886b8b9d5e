"""Hypothetical rollouts: sequences of actions played from any state, with fresh or with recorded noise."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arguments import public
from ibdata._numerics.arrays import Float32s, Ints
from ibdata._numerics.random import Purpose, Raw, stream_key
from ibdata._simulation import addresses
from ibdata._simulation.addresses import Digests
from ibdata._simulation.carry import Carry, begin
from ibdata._simulation.episodes import Episodes, World, observed_rows, record_rows, values_of
from ibdata._simulation.unroll import LANES, unroll
from ibdata._system.memory import refuse_too_much
from ibdata.dataset.dataset import whole_dataset
from ibdata.dynamics import State
from ibdata.dynamics.state import checked_state
from ibdata.errors import UsageError, excerpt
from ibdata.evaluation.play import rewarded, rewards_of
from ibdata.evaluation.states import WATCHER, Replayable
from ibdata.experiment.scenario import scenario_of
from ibdata.plan.rollout import episodes_of
from ibdata.policies.distributions import finite_actions
from ibdata.views.options import View, ViewOptions, Window, view_of

RECORDED = "recorded"


@dataclasses.dataclass(eq=False, repr=False)
class Lanes:
    """Where n lanes are, where their noise goes on, and what was seen of them."""

    world: World
    state: State
    starts: Digests  # of the first states
    noise: int | str
    keys: Raw  # (n, 2)
    index: Ints  # (n,)
    samples: int  # of each first state
    step: Ints  # (n,)
    view: ViewOptions
    window: Window | None = None  # where a view shows more than the state

    def take(self, lanes: Ints) -> Lanes:
        """A copy of some lanes, without the window."""
        taken = dataclasses.replace(self, state=self.state.take(lanes), window=None)
        for name in ("starts", "keys", "index", "step"):
            setattr(taken, name, getattr(self, name)[lanes])
        return taken

    def look(self, states: State, numbers: Ints) -> Window:
        """What is seen of the lanes (n,), from their latest states (n · times), newest first."""
        n, drifting = len(self.step), self.world.drifting
        window = Window(self.view, drifting, n, 1)
        clean = values_of(states, observed_rows(self.view, drifting)).reshape(n, states.lanes // n, -1)
        window.begin(np.arange(n), clean[:, -1], numbers)
        for age in range(clean.shape[1] - 2, -1, -1):
            known = np.flatnonzero(self.step > age)
            window.push(known, clean[known, age], np.zeros((len(known), 3), np.float32))
        return window


class Rollouts(NamedTuple):
    """What n starts, k sequences of h actions and some samples of the noise gave.

    Attributes:
        rewards: the rewards (n, k, samples, h).
        observations: what is seen after each action (n, k, samples, h, columns).
        state: the last states, n · k · samples lanes in the order of the arrays.
        lanes: what `rollouts` needs to go on from here; its fields may change.
    """

    rewards: Float32s
    observations: Float32s
    state: State
    lanes: Lanes


@dataclasses.dataclass(frozen=True, eq=False)
class Noisy(Episodes):
    """Episodes whose noise goes on from a step of their own; equal lanes of `unit` share it."""

    first_step: Ints  # (units,)
    unit: Ints  # (n,): which of the addresses (units,) a lane has

    def __len__(self) -> int:
        return len(self.unit)

    def draw(self, lanes: Ints, purpose: Purpose, step: int, steps: int, slots: int) -> Raw:
        """The integers (steps, slots, lanes) at the addresses of all lanes."""
        out = np.empty((steps, slots, len(self.index)), dtype=np.uint64)
        for first in np.unique(self.first_step).tolist():
            here = np.flatnonzero(self.first_step == first)
            out[:, :, here] = super().draw(here, purpose, first + step, steps, slots)
        return out[:, :, self.unit]


@public
def rollouts(
    start: Any,
    actions: npt.ArrayLike,
    *,
    rows: Any = None,
    samples: int = 1,
    noise: int | str | None = None,
    view: View = None,
) -> Rollouts:
    """Play sequences of actions from any state: what would have happened.

    The noise is decided by `noise`, the values of the start, its number among equal starts of the call, the
    sample and the step. So the k sequences from a start share it, and their differences are paired. Starts
    and samples are independent, in whatever order and calls. A `State` is always a new start.

    Args:
        start: The n starts. Either a dataset, its folder or URL, with `rows`; or a `State` of n lanes, as of
            `ibdata.state_at` or an environment's `state`, with the dynamics `siemens`, or ("paper", state);
            or the settings of one start for each setpoint, such as {"setpoint": 70, "start": "uniform",
            "dynamics": "paper"}, drawn by `noise`; or earlier rollouts, all of whose lanes go on, with the
            next steps of their noise.
        actions: (k, h, 3) for all starts, or (n, k, h, 3); clipped to [-1, 1] and rounded to float32.
        rows: The rows of the dataset before whose actions the rollouts start, as in `state_at`.
        samples: How often each sequence is played, each time with other noise.
        noise: The seed of the noise, by default 0 or that of the earlier rollouts; or "recorded", the noise
            of the dataset's own episodes. With it, the actions of a row give the row that follows, as
            float32, and other actions the counterfactual. A planner that has the seed of what is played
            looks ahead: give it another one.
        view: What is observed and rewarded, as the options of a view (the page "Views and costs"),
            by default that of the earlier rollouts. Imperfections have their own seed; they know the rows
            before a row, and what earlier rollouts showed.

    Returns:
        Rewards (n, k, samples, h), observations (n, k, samples, h, columns), and the last states.

    Raises:
        UsageError, ConfigError: An argument is invalid, or the dataset has no such row.
        DatasetError: The rows are damaged, or this ibdata cannot simulate them again.
    """
    going_on = isinstance(start, Rollouts)
    options = start.lanes.view if going_on and view is None else view_of(view)
    if samples < 1:
        raise UsageError(f"samples: found {samples}, expected at least 1")
    if options.cost is not None:
        raise UsageError("view: found a cost, which rollouts do not return; leave it out")
    if noise is None:
        noise = start.lanes.noise if going_on else 0
    if isinstance(noise, str):
        has_record = rows is not None or (going_on and start.lanes.noise == RECORDED)
        is_valid = noise == RECORDED and has_record and samples == 1
    else:
        is_valid = 0 <= noise < 2**64
    if not is_valid:
        expected = "a seed in [0, 2^64), or 'recorded' with rows of a dataset and one sample"
        raise UsageError(f"noise: found {noise!r}, expected {expected}")
    if rows is not None:
        begun = _before_rows(start, rows, noise, options)
    else:
        begun = (_after if going_on else _begun)(start, noise, options)
    n, played = len(begun.step), _applied(actions, len(begun.step))
    k, h = played.shape[1:3]
    shape, columns = (n, k, samples), len(options.frame(begun.world.drifting))
    size = begun.state.values[:, 0].nbytes + 4 * (h * (1 + columns) + (1 + _delay(options)) * columns)
    refuse_too_much("samples", size * n * k * samples)
    first, _, sample = np.unravel_index(np.arange(n * k * samples), shape)
    lanes = begun.take(first)
    lanes.index += begun.samples * sample
    lanes.samples *= samples
    if options.imperfections or options.actions:
        window = begun.window or begun.look(begun.state, _numbers(begun))
        lanes.window = window.take(first, lanes.step, None if noise == RECORDED else _numbers(lanes))
    rewards, observations = np.empty((*shape, h), np.float32), np.empty((*shape, h, columns), np.float32)
    _play(lanes, shape, played, rewards.reshape(-1, h), observations.reshape(-1, h, columns))
    lanes.step += h
    return Rollouts(rewards, observations, lanes.state, lanes)


def _before_rows(ds: Any, rows: Any, noise: int | str, view: ViewOptions) -> Lanes:
    """Lanes before rows of a dataset, of which the rows before were seen."""
    source = Replayable(whole_dataset(ds).stored)
    episodes, steps = source.episodes_and_steps(rows)
    n, times = len(episodes), 1 + (int(steps.max()) if view.imperfections.missing else _delay(view))
    refuse_too_much("rows", State.zeros(1).values.nbytes * n * times)
    latest = np.maximum(steps[:, None] - np.arange(times), 0)
    states = source.carries_at(np.repeat(episodes, times), latest.ravel()).state
    by_experiment = list(source.by_experiment(episodes))
    world = by_experiment[0][0].scenario.world  # experiments of one dataset have equal ones
    lanes = _first(world, states.take(np.arange(0, n * times, times)), noise, view)
    if noise == RECORDED:
        for experiment, positions, inner in by_experiment:
            recorded = episodes_of(experiment, inner)
            lanes.keys[positions], lanes.index[positions] = recorded.keys, recorded.index
    lanes.step = steps
    if view.imperfections:
        lanes.window = lanes.look(states, episodes)
    if noise != RECORDED:
        lanes.step = np.zeros_like(steps)
    return lanes


def _after(earlier: Rollouts, noise: int | str, view: ViewOptions) -> Lanes:
    """The lanes of earlier rollouts, with other noise if it is not theirs."""
    lanes = earlier.lanes
    if view.imperfections and view != lanes.view:
        expected = "that of the earlier rollouts; their state begins anew"
        raise UsageError(f"view: found another view with imperfections, expected {expected}")
    keys, index = lanes.keys, lanes.index
    if noise != lanes.noise:
        keys = _keys(noise, lanes.starts)
        index = np.zeros_like(index) if lanes.noise == RECORDED else index  # that of a recorded episode
    window = lanes.window if view.imperfections else None
    return dataclasses.replace(
        lanes, state=earlier.state, noise=noise, keys=keys, index=index, view=view, window=window
    )


def _begun(start: Any, noise: int | str, view: ViewOptions) -> Lanes:
    """Lanes that begin in a state, or as settings say."""
    dynamics, state = start if isinstance(start, tuple) and len(start) == 2 else ("siemens", start)
    if isinstance(state, State):
        world = scenario_of(dynamics=dynamics).world
        try:
            state = checked_state(state, world.variant)
        except ValueError as error:
            raise UsageError(f"start: {str(error).removeprefix('step: ')}") from None
        moves = state.drift_left >= 0
        if not len(moves) or moves.any() != moves.all():
            raise UsageError("start: expected lanes that all have constant setpoints, or all moving ones")
        world = dataclasses.replace(world, drifting=bool(moves.any()))
    elif isinstance(start, Mapping):
        if unknown := {str(name) for name in start} - {"setpoint", "start", "dynamics"}:
            raise UsageError(f"start: found {min(unknown)}, expected setpoint, start and dynamics")
        scenario = scenario_of(**start)
        world, points = scenario.world, np.array(scenario.points)
        keys = _keys(noise, addresses.of_starts(points[None]))
        index = np.zeros(len(points), np.int64)
        state = begin(Episodes(world, WATCHER, WATCHER.label, keys, keys, index, points, index)).state
    else:
        raise UsageError(
            f"start: found {excerpt(start)}, expected a dataset with rows=, a State, or settings such as "
            "{'setpoint': 70}"
        )
    return _first(world, state, noise, view)


def _first(world: World, state: State, noise: int | str, view: ViewOptions) -> Lanes:
    """Lanes whose noise begins in this state."""
    starts, zeros = addresses.of_starts(state.values), np.zeros(state.lanes, np.int64)
    return Lanes(world, state, starts, noise, _keys(noise, starts), zeros, 1, zeros, view)


def _keys(noise: int | str, starts: Digests) -> Raw:
    """The keys (n, 2) of the noise from starts; of recorded noise, which has its own, any."""
    seed = 0 if isinstance(noise, str) else noise
    return np.array([stream_key(seed, start.tobytes()) for start in starts])


def _numbers(lanes: Lanes) -> Ints:
    """Random numbers (n,) of episodes, for the addresses of measurements."""
    numbers: Ints = (lanes.keys[:, 0] >> np.uint64(2)).astype(np.int64) + lanes.index
    return numbers


def _delay(view: ViewOptions) -> int:
    """The most steps by which a measurement is late."""
    return max(view.imperfections.delay.values(), default=0)


def _play(
    lanes: Lanes, shape: tuple[int, int, int], actions: Float32s, rewards: Float32s, observations: Float32s
) -> None:
    """Play sequences (n, k, h, 3) in lanes (n · k · samples), those of a sample side by side, in place.

    Writes rewards (lanes, h) and observations (lanes, h, columns).
    """
    view, h = lanes.view, actions.shape[2]
    paid, seen = record_rows(rewarded(view)), observed_rows(view, lanes.world.drifting)
    in_order = np.arange(len(rewards)).reshape(shape).swapaxes(1, 2).ravel()
    for first in range(0, len(in_order), LANES):
        here = in_order[first : first + LANES]
        start, sequence, sample = np.unravel_index(here, shape)
        # A sample from a start has one noise, which is drawn once.
        _, one, unit = np.unique(start * shape[2] + sample, return_index=True, return_inverse=True)
        units = lanes.take(here[one])
        noisy = Noisy(
            lanes.world, WATCHER, WATCHER.label, units.keys, units.keys, units.index, units.state.setpoint,
            number=here, first_step=units.step, unit=unit,
        )  # fmt: skip
        carry = Carry.at(lanes.state.take(here), WATCHER.needs)
        recorded = np.ascontiguousarray(actions[start, sequence].transpose(1, 0, 2))
        for block in unroll(noisy, carry, np.concatenate([paid, seen]), h, recorded=recorded):
            steps = slice(block.first, block.stop)
            rewards[here, steps] = rewards_of(block.record[: len(paid)], view, view.reward_scale).T
            clean = (block.record[len(paid) :, 1:].T + 0.0).astype(np.float32)  # (lanes, steps, columns)
            if lanes.window is None:
                observations[here, steps] = clean
                continue
            for t, taken in enumerate(block.actions):
                lanes.window.push(here, clean[:, t], taken)
                observations[here, block.first + t] = lanes.window.frames[here, 0]
        lanes.state.put(here, carry.state)


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
