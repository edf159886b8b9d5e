"""The simulation behind the environments, fed with random integers that the caller draws."""

from __future__ import annotations

import dataclasses
from struct import unpack
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arrays import Float32s, Floats
from ibdata._numerics.naming import counted
from ibdata._numerics.random import Purpose, Raw
from ibdata._simulation import kernel
from ibdata._simulation.carry import Carry, begin_lanes
from ibdata._simulation.episodes import Draw, World, hidden_variables, observed_rows, record_rows, values_of
from ibdata.dynamics import State, initial_state
from ibdata.dynamics.noise import DRIFT_SLOTS, DYNAMICS_SLOTS
from ibdata.dynamics.state import checked_state
from ibdata.environment.settings import Settings
from ibdata.errors import UsageError
from ibdata.policies import OBSERVATION, Needs
from ibdata.policies.distributions import Action, applied
from ibdata.views.options import Window
from ibdata.views.rewards import scaled
from ibdata.views.variables import FIRST_WHOLE, ROWS, VARIABLES, variable_of

Indices = npt.NDArray[np.int64]
PAID_BY_ROWS = [OBSERVATION.index("consumption"), OBSERVATION.index("fatigue")]
REWARD = ROWS.index("reward")


class Simulation:
    """n lanes, which are episodes simulated at once, under one setting.

    A `Draw` returns the next integers of each lane, whatever their address. A start takes 4 where it is
    random; a step takes 8, and 4 more if the setpoint moves; a step of the burn-in 4 more for its action. So
    a lane is the same whatever the other lanes do.
    """

    def __init__(self, settings: Settings, n: int) -> None:
        drifting, view = settings.world.drifting, settings.view
        self.settings, self.n, self.everyone = settings, n, np.arange(n)
        self.needs = Needs(history=settings.history)
        state = initial_state(np.full(n, settings.setpoint), drifting=drifting)
        self.carry = _without_actions(Carry.at(state, self.needs))
        self._window = None if view.is_classic else Window(view, drifting, n, settings.history)
        self.observed_rows = observed_rows(view, drifting)
        imperfect = view.imperfections.columns
        self._clean = {f"clean_{c}": i for i, c in enumerate(view.columns(drifting)) if c in imperfect}
        latent = {f"latent_{name}": ROWS.index(name) for name in hidden_variables(drifting)}
        by_type = sorted(latent, key=lambda name: latent[name] >= FIRST_WHOLE)
        self._latent = {name: by_type.index(name) for name in latent}
        ordered = np.array([latent[name] for name in by_type])
        self._floats, self._wholes = ordered[ordered < FIRST_WHOLE], ordered[ordered >= FIRST_WHOLE]
        self._of_cost = record_rows([] if view.cost is None else list(map(variable_of, view.cost.variables)))

        self._cost = np.zeros(0 if view.cost is None else n)  # of the last step; 0 where there was none

    def reset(self, which: Indices, draw: Draw) -> None:
        """Begin episodes in these lanes (k,): the start, the zero-action step, the burn-in."""
        setpoints = np.full(len(which), self.settings.setpoint)
        carry = begin_lanes(self.settings.world, draw, which, setpoints, self.needs, self.observed_rows)
        self.place(which, carry, self._numbers(which, draw))

    def set_state(self, proposed: State, which: Indices, draw: Draw) -> None:
        """Go on from a state of k lanes in these lanes (k,). Raises UsageError if it is no such state."""
        state = _fitting(proposed, len(which), self.settings.world)
        self.place(which, Carry.at(state, self.needs), self._numbers(which, draw))

    def place(self, which: Indices, carry: Carry, numbers: Indices) -> None:
        """Put these lanes (k,) where other episodes are, as episodes with these numbers (k,)."""
        self.carry.put(which, _without_actions(carry))
        if self.settings.view.cost is not None:
            self._cost[which] = 0.0
        if self._window is not None:
            self._window.begin(which, self._true_values()[which], numbers, carry.burn_in)

    def step(self, which: Indices, actions: Float32s, draw: Draw) -> Floats:
        """Move these lanes (k,) by actions (k, 3). Returns the scaled rewards (k,), a new array."""
        everyone, world = len(which) == self.n, self.settings.world
        carry = self.carry if everyone else self.carry.take(which)
        before = self._costs(carry)
        carry.advance(world, actions[None], *world.integers(draw, which, 0, 1))
        if not everyone:
            self.carry.put(which, carry)
        if self._window is not None:
            self._window.push(which, self._true_values()[which], actions)
        self._pay(which)
        return self._rewards(carry.state.values[REWARD], before, self._costs(carry))

    def _pay(self, which: Indices) -> None:
        """Note the costs of a step to the states of these lanes (k,)."""
        if (cost := self.settings.view.cost) is not None:
            self._cost[which] = cost.of(tuple(values_of(self.carry.state, self._of_cost).T))[which]

    def observations(self) -> Float32s:
        """The observations (n, k · history), newest first; a new array each time."""
        frames = self.carry.observations if self._window is None else self._window.frames
        return frames.reshape(self.n, -1).copy()

    def info(self) -> dict[str, npt.NDArray[Any]]:
        """What the agent is not meant to see by name, arrays (n,), new ones each time.

        These are the hidden part of the Markov state, the true values of imperfect measurements, and the cost
        of the last step, which is 0 at the start of an episode.
        """
        values = self.carry.state.values
        wholes = values.take(self._wholes, axis=0).astype(np.int64)
        arrays = [*values.take(self._floats, axis=0), *wholes]
        return {name: arrays[i] for name, i in self._latent.items()} | self._beside()

    def _beside(self) -> dict[str, npt.NDArray[Any]]:
        """What a view adds to the hidden state by name, arrays (n,)."""
        values: dict[str, npt.NDArray[Any]] = {}
        if self._clean:
            observed = self._true_values()
            values = {name: observed[:, i].astype(np.float64) for name, i in self._clean.items()}
        if self.settings.view.cost is not None:
            values["cost"] = self._cost.copy()
        return values

    def _numbers(self, which: Indices, draw: Draw) -> Indices:
        """Numbers of new episodes (k,): parts of the addresses of the imperfections' random numbers."""
        if not self.settings.view.imperfections:
            return np.zeros(len(which), dtype=np.int64)
        numbers: Indices = (draw(which, Purpose.MEASUREMENT, 0, 1, 1)[0, 0] >> np.uint64(1)).astype(np.int64)
        return numbers

    def _true_values(self) -> Float32s:
        """The true values of the observed columns, (n, columns)."""
        return values_of(self.carry.state, self.observed_rows)

    def _costs(self, carry: Carry) -> Float32s | None:
        """A copy of consumption and fatigue (2, k), of which other rewards than the classic one are made."""
        return (
            None if self.settings.view.reward.kind == "classic" else carry.observations[:, 0, PAID_BY_ROWS].T
        )

    def _rewards(self, classic: Floats, before: Float32s | None, after: Float32s | None) -> Floats:
        """The scaled rewards (k,), from the classic ones, or from the costs before and after the step."""
        view = self.settings.view
        if before is None or after is None:
            return scaled(classic, view.reward_scale).astype(np.float64)
        return view.reward.of(tuple(before), tuple(after), view.reward_scale).astype(np.float64)


def _without_actions(carry: Carry) -> Carry:
    """The same without the latest actions, which no environment shows."""
    return dataclasses.replace(carry, actions=carry.actions[:, :0])


def _fitting(proposed: Any, lanes: int, world: World) -> State:
    """A copy of a state of so many lanes, whose setpoints move or do not."""
    if not isinstance(proposed, State):
        raise UsageError(
            f"set_state: found {type(proposed).__name__}, expected a State as of ibdata.state_at"
        )
    try:
        state = checked_state(proposed, world.variant)
    except ValueError as error:
        raise UsageError(f"set_state: {str(error).removeprefix('step: ')}") from None
    moves = state.drift_left >= 0
    if len(moves) != lanes:
        kind, expected = counted(len(moves), "lane"), counted(lanes, "lane")
        raise UsageError(f"set_state: found a state of {kind}, expected a state of {expected}")
    if (moves != world.drifting).any():
        kind, option = ("a constant", "a number") if world.drifting else ("a moving", '"drifting"')
        raise UsageError(
            f"set_state: found a state of {kind} setpoint; make the environment with setpoint={option}"
        )
    return state


DRAWN = (*OBSERVATION, "mu_v", "mu_g", "direction")


class Lane(Simulation):
    """One lane. A call of NumPy takes as long as half the equations, so there are few."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings, 1)
        drifting, view = settings.world.drifting, settings.view
        self.draws = DYNAMICS_SLOTS + DRIFT_SLOTS * drifting  # random integers of a step
        self._parameters = settings.world.parameters
        self._plain = view.is_classic and not view.changed().keys() - {"observe"}
        names = (*hidden_variables(drifting), "reward")
        self._rows, self._out = record_rows(names), np.zeros(len(names))
        self._types = "".join("q" if VARIABLES[name].whole else "d" for name in names)

    def move(self, action: Action, raw: Raw) -> tuple[Float32s, float, dict[str, float]]:
        """Make a step; return observation, scaled reward, and hidden variables by column name."""
        carry, (dv, dg, dh) = self.carry, action
        before = None if self._plain else self._costs(carry)
        kernel.simulate_lane(
            carry.state.values, dv, dg, dh, raw, self._parameters, carry.observations, self._rows, self._out
        )
        numbers = unpack(self._types, self._out)  # type: ignore[arg-type]  # an array is a buffer
        info = dict(zip(self._latent, numbers))  # noqa: B905  # the last number is the reward
        if self._plain:
            return carry.observations.ravel().copy(), numbers[-1], info
        if self._window is not None:
            self._window.push(self.everyone, self._true_values(), applied([action]))
        self._pay(self.everyone)
        info |= {name: values[0].item() for name, values in self._beside().items()}
        [reward] = self._rewards(carry.state.reward, before, self._costs(carry)).tolist()
        return self.observations()[0], reward, info

    def drawn(self) -> dict[str, float]:
        """The variables that a picture of an episode shows."""
        return {name: getattr(self.carry.state, name)[0].item() for name in DRAWN}
