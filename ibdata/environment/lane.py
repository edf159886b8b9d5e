"""The simulation behind the environment of one lane, of which a step takes a few microseconds."""

from __future__ import annotations

import math
from struct import unpack
from typing import Any

import numpy as np

from ibdata.dynamics import State
from ibdata.environment.settings import Settings
from ibdata.environment.simulation import COSTS, Float32s, Simulation, checked_actions
from ibdata.numerics.philox import Raw
from ibdata.policies.actions import clip_and_round
from ibdata.simulation import kernel
from ibdata.simulation.episodes import NO_PAST, NO_ROWS, Episodes, Past
from ibdata.simulation.noise import DRIFT_SLOTS, DYNAMICS_SLOTS
from ibdata.simulation.variables import hidden, record_rows
from ibdata.variables import VARIABLES

Action = tuple[float, float, float]
NOTHING = np.empty(0)


class _Episode(Episodes):
    """Begins episodes with the compiled function that makes the steps, so that no other is loaded."""

    def advance(
        self, state: State, actions: Float32s, raw: Raw, drift: Raw, past: Past = NO_PAST, *_: Any
    ) -> None:
        integers = np.concatenate([raw.ravel(), drift.ravel()])
        dv, dg, dh = actions[0, 0].tolist()
        seen = past.observations
        kernel.simulate_lane(*state, dv, dg, dh, integers, self.parameters, seen, NO_ROWS, NOTHING)


class Lane(Simulation):
    """One lane. A call of NumPy takes as long as half the equations, so there are few."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings, 1)
        self._episodes = _Episode(*self._episodes)
        self.draws = DYNAMICS_SLOTS + DRIFT_SLOTS * settings.drifting  # random integers of a step
        self._parameters, self._reward_scale = self._episodes.parameters, settings.reward_scale
        self._plain = self.window is None and self.view.reward.kind == "classic"
        wanted = (*hidden(settings.drifting), "reward")
        self._rows, self._out = record_rows(wanted), np.zeros(len(wanted))
        self._form = "".join("q" if VARIABLES[name].whole else "d" for name in wanted)

    def move(self, action: Action, raw: Raw) -> tuple[Float32s, float, dict[str, float]]:
        """Make a step; return observation, scaled reward, and hidden variables by column name."""
        (floats, integers), (dv, dg, dh) = self._state, action
        if self.keeps_costs:
            self.costs_before[:] = self.seen[:, 0, COSTS]
        kernel.simulate_lane(
            floats, integers, dv, dg, dh, raw, self._parameters, self.seen, self._rows, self._out
        )
        numbers = unpack(self._form, self._out)  # type: ignore[arg-type]  # an array is a buffer
        info = dict(zip(self._latent, numbers))  # noqa: B905  # the reward is left over
        if self._plain:
            reward = numbers[-1] if self._reward_scale == 1 else self.rewards()[0].item()
            return self.seen.ravel().copy(), reward, info
        if self.window is not None:
            rounded = np.empty((1, 3), dtype=np.float32)
            clip_and_round(np.array([action]), rounded)
            self.window.push(self.everyone, self.observed(), rounded)
        return self.observations()[0], self.rewards()[0].item(), {**info, **self._true_values()}

    def _true_values(self) -> dict[str, float]:
        """The true values of imperfect measurements by name."""
        observed = self.observed()[0].tolist() if self._clean else []
        return {name: observed[i] for name, i in self._clean.items()}


def checked_action(given: Any) -> Action:
    """Return the three numbers of an action; an array of three finite floats takes a short way.

    Raises UsageError if it is no action.
    """
    if type(given) is np.ndarray and given.shape == (3,) and given.dtype.char in "fd":
        dv, dg, dh = given.tolist()
        if math.isfinite(dv + dg + dh):
            return dv, dg, dh
    dv, dg, dh = checked_actions([given], np.ones(1, dtype=bool))[0].tolist()
    return dv, dg, dh
