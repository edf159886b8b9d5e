"""The simulation behind the environments, fed with random integers that the caller draws."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.dynamics import State, initial_state
from ibdata.environment.fitting_state import fitting_state
from ibdata.environment.settings import Settings
from ibdata.errors import UsageError, excerpt
from ibdata.numerics.philox import Raw
from ibdata.numerics.random import Purpose
from ibdata.policies import OBSERVATION
from ibdata.policies.actions import clip_and_round
from ibdata.simulation import episodes
from ibdata.simulation.episodes import NO_PAST, Episodes, Past, put, take
from ibdata.simulation.variables import hidden, observed_rows, values_of
from ibdata.variables import VARIABLES, rows
from ibdata.views.rewards import scaled
from ibdata.views.window import Window

Indices = npt.NDArray[np.int64]
Float32s = npt.NDArray[np.float32]
COSTS = [OBSERVATION.index("consumption"), OBSERVATION.index("fatigue")]
DRAWN = (*OBSERVATION, "mu_v", "mu_g", "direction")
Draw = Callable[[Indices, int], Raw]  # (lanes, count) -> (lanes, count) random 64-bit integers


class Simulation:
    """n lanes, which are episodes simulated at once, under one setting.

    A start takes 4 integers where it is random; a step takes 8, and 4 more if the setpoint moves; a step of
    the burn-in 4 more for its action. So a lane is the same whatever the other lanes do.
    """

    def __init__(self, settings: Settings, n: int) -> None:
        self.settings, self.n, self.view = settings, n, settings.view
        self.everyone = np.arange(n)
        self.seen = np.zeros((n, settings.history, 6), dtype=np.float32)
        self._state = initial_state(np.full(n, settings.first_setpoint), drifting=settings.drifting)
        self._episodes = Episodes.of(settings.start, settings.drifting, settings.variant)
        self.window = None
        if not self.view.is_classic:
            self.window = Window(self.view, settings.drifting, n, settings.history)
        self.keeps_costs = self.view.reward.kind == "delta"
        self.costs_before = self.seen[:, 0, COSTS].copy()  # consumption and fatigue before the last step
        columns = self.view.columns(settings.drifting)
        self._observed = observed_rows(self.view, settings.drifting)
        self._clean = {
            f"clean_{name}": i for i, name in enumerate(columns) if name in self.view.imperfections.columns
        }
        # Where the hidden variables lie in the state; views of it would not be its own in a copy of this.
        self._latent = {
            f"latent_{name}": (int(VARIABLES[name].whole), rows(name)[0])
            for name in hidden(settings.drifting)
        }

    def reset(self, which: Indices, draw: Draw) -> None:
        """Begin episodes in these lanes: the start, the zero-action step, the burn-in."""
        setpoints = np.full(len(which), self.settings.first_setpoint)
        begun = self._episodes.begin(_one_step(draw), which, setpoints, self.settings.history)
        self.place(which, *begun, self._numbers(which, draw))

    def _numbers(self, which: Indices, draw: Draw) -> Indices:
        """Numbers of new episodes (k,): parts of the addresses of the imperfections' random numbers."""
        if not self.view.imperfections:
            return np.zeros(len(which), dtype=np.int64)
        return (draw(which, 1)[:, 0] >> np.uint64(1)).astype(np.int64)

    def replay(
        self, which: Indices, draw: episodes.Draw, start: Any, setpoints: episodes.Floats, numbers: Indices
    ) -> None:
        """Begin episodes of a dataset in these lanes (k,), with their start, setpoints and numbers (k,)."""
        own = self._episodes._replace(start=start)
        begun = own.begin(draw, np.arange(len(which)), setpoints, self.settings.history)
        self.place(which, *begun, numbers)

    def set_state(self, given: State, which: Indices, draw: Draw) -> None:
        """Go on from a state of k lanes in these lanes (k,). Raises UsageError if it is no such state."""
        state = fitting_state(given, len(which), self.settings.drifting)
        self.place(which, state, Past.of(state, self.settings.history), self._numbers(which, draw))

    def place(self, which: Indices, state: State, past: Past, numbers: Indices) -> None:
        """Put these lanes into the states of k lanes that have this past, as episodes with these numbers."""
        put(self._state, which, state)
        self.seen[which] = past.observations
        self.costs_before[which] = self.seen[which, 0][:, COSTS]
        if self.window is not None:
            self.window.begin(which, self.observed()[which], numbers)

    def step(self, which: Indices, action: Float32s, draw: Draw) -> None:
        """Move these lanes by actions (k, 3)."""
        raw, drift = self._episodes.integers(_one_step(draw), which, 0, 1)
        everyone = len(which) == self.n
        state = self._state if everyone else take(self._state, which)
        seen = self.seen if everyone else self.seen[which]
        if self.keeps_costs:
            self.costs_before[which] = seen[:, 0, COSTS]
        self._episodes.advance(state, action[None], raw, drift, Past(seen, NO_PAST.actions))
        if not everyone:
            put(self._state, which, state)
            self.seen[which] = seen
        if self.window is not None:
            self.window.push(which, self.observed()[which], action)

    def observations(self) -> Float32s:
        """Return the observations (n, k · history), newest first; a new array each time."""
        frames = self.seen if self.window is None else self.window.frames
        return frames.reshape(self.n, -1).copy()

    def observed(self) -> Float32s:
        """The true values of the observed columns, (n, columns)."""
        return values_of(self._state, self._observed)

    def rewards(self) -> npt.NDArray[np.float64]:
        """The rewards (n,), scaled; a new array each time."""
        reward, scale = self.view.reward, self.settings.reward_scale
        if reward.kind == "classic":
            return scaled(self._state.reward, scale).astype(np.float64)
        before, after = self.costs_before.T, self.seen[:, 0, COSTS].T
        return reward.of(tuple(before), tuple(after), scale).astype(np.float64)

    def drawn(self) -> dict[str, npt.NDArray[Any]]:
        """The variables that a picture of an episode shows, arrays (n,)."""
        return {name: getattr(self._state, name) for name in DRAWN}

    def latent(self) -> dict[str, npt.NDArray[Any]]:
        """What the agent is not meant to see by name, arrays (n,), new ones each time.

        These are the hidden part of the Markov state and the true values of imperfect measurements.
        """
        hidden = {name: self._state[part][row].copy() for name, (part, row) in self._latent.items()}
        if not self._clean:
            return hidden
        observed = self.observed()
        return {**hidden, **{name: observed[:, i].copy() for name, i in self._clean.items()}}


def checked_actions(given: Any, used: npt.NDArray[np.bool_]) -> Float32s:
    """Actions (n, 3), clipped to [-1, 1] and rounded, zero in lanes (n,) that use none.

    Raises UsageError for another shape, or numbers that are not finite.
    """
    try:
        proposed = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        proposed = np.empty(0)
    shape = (len(used), 3)
    if proposed.shape == shape:
        proposed[~used] = 0.0
    if proposed.shape != shape or not np.isfinite(proposed).all():
        raise UsageError(
            f"action: found {excerpt(given, 80)}, expected {shape} finite numbers: "
            "changes of velocity, gain and shift in [-1, 1]"
        )
    out = np.empty(shape, dtype=np.float32)
    clip_and_round(proposed, out)
    return out


def _one_step(draw: Draw) -> episodes.Draw:
    """The driver's source of integers: the next of each lane, whatever their address."""

    def integers(lanes: Indices, purpose: Purpose, step: int, steps: int, slots: int) -> Raw:
        return draw(lanes, slots).T.reshape(1, slots, -1)

    return integers
