"""Lanes of the benchmark that are reset and moved one by one or together, by integers the caller draws."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.dynamics import State, initial_state
from ibdata.environment.settings import Settings
from ibdata.errors import UsageError
from ibdata.experiment.fields import BurnIn
from ibdata.experiment.start import burn_in_steps, steerings
from ibdata.numerics.philox import Raw
from ibdata.numerics.random import slots, uniforms
from ibdata.policies import OBSERVATION
from ibdata.policies.actions import clip_and_round
from ibdata.simulation import kernel
from ibdata.simulation.noise import DRIFT_SLOTS, DYNAMICS_SLOTS, blank_noise
from ibdata.simulation.variables import DRIFT, LATENT

Indices = npt.NDArray[np.int64]
Float32s = npt.NDArray[np.float32]
DRAWN = (*OBSERVATION, "mu_v", "mu_g", "direction")
Draw = Callable[[Indices, int], Raw]  # (lanes, count) -> (lanes, count) random 64-bit integers


class Simulation:
    """n lanes, which are episodes simulated at once, under one setting.

    A start takes 4 integers where it is random; a step takes 8, and 4 more if the setpoint moves; a step of
    the burn-in 4 more for its action. So a lane is the same whatever the other lanes do.
    """

    def __init__(self, settings: Settings, n: int) -> None:
        self.settings, self.n = settings, n
        self.everyone = np.arange(n)
        self.state = initial_state(np.full(n, settings.first_setpoint), drifting=settings.drifting)
        self.seen = np.zeros((n, settings.history, 6), dtype=np.float32)
        self._noise = blank_noise(n)
        self._parameters = settings.variant.parameters()

    def reset(self, which: Indices, draw: Draw) -> None:
        """Begin episodes in these lanes: the start, the zero-action step, the burn-in."""
        start, k = self.settings.start, len(which)
        u = np.empty((k, 3)) if start == "default" else _uniforms(draw(which, slots(3)), 3)
        state = initial_state(
            np.full(k, self.settings.first_setpoint), *steerings(start, u), drifting=self.settings.drifting
        )
        self._move(state, np.zeros((k, 3), dtype=np.float32), self._raw(which, draw))
        if isinstance(start, BurnIn):
            self._burn_in(state, burn_in_steps(start, u), which, draw)
        self._observe(state, which, True)

    def _burn_in(self, state: State, counts: Indices, which: Indices, draw: Draw) -> None:
        """Move each lane of the state by counts (k,) steps with uniform random actions."""
        for t in range(int(counts.max())):
            running = np.flatnonzero(t < counts)
            raw = self._raw(which[running], draw)
            u = _uniforms(draw(which[running], slots(3)), 3)
            action = np.empty(u.shape, dtype=np.float32)
            clip_and_round(2.0 * u - 1.0, action)
            part = _taken(state, running)
            self._move(part, action, raw)
            _put(state, running, part)

    def step(self, which: Indices, action: Float32s, draw: Draw) -> None:
        """Move these lanes by actions (k, 3)."""
        raw = self._raw(which, draw)
        if len(which) == self.n:
            self._move(self.state, action, raw)
            kernel.observe(self.state, self.seen, False)
            return
        part = _taken(self.state, which)
        self._move(part, action, raw)
        self._observe(part, which, False)

    def _raw(self, which: Indices, draw: Draw) -> tuple[Raw, Raw]:
        """The integers of one step as (1, 8, k) and (1, 4, k), the latter (0, 4, k) if nothing drifts."""
        dynamics = _one_step(draw(which, DYNAMICS_SLOTS))
        if self.settings.drifting:
            return dynamics, _one_step(draw(which, DRIFT_SLOTS))
        return dynamics, np.empty((0, DRIFT_SLOTS, len(which)), dtype=np.uint64)

    def _move(self, state: State, action: Float32s, raw: tuple[Raw, Raw]) -> None:
        n = len(action)
        noise = self._noise if n == self.n else blank_noise(n)
        kernel.step_lanes(state, action, *raw, 0, noise, self._parameters)

    def _observe(self, state: State, which: Indices, first: bool) -> None:
        """Write the state of some lanes, and put their new observation in front of their history."""
        _put(self.state, which, state)
        seen = self.seen[which]
        kernel.observe(state, seen, first)
        self.seen[which] = seen

    def observations(self) -> Float32s:
        """Return the observations (n, 6 · history), newest first; a new array each time."""
        return self.seen.reshape(self.n, -1).copy()

    def rewards(self) -> npt.NDArray[np.float64]:
        """The rewards (n,), scaled; a new array each time."""
        return self.state.reward * self.settings.reward_scale

    def drawn(self) -> dict[str, npt.NDArray[Any]]:
        """The variables that a picture of an episode shows, arrays (n,)."""
        return {name: getattr(self.state, name) for name in DRAWN}

    def latent(self) -> dict[str, npt.NDArray[Any]]:
        """The hidden part of the Markov state by column name, arrays (n,), new ones each time."""
        names = LATENT + (DRIFT if self.settings.drifting else ())
        return {
            f"latent_{name}": (
                self.state.operational_cost[:, 9 - int(name[6:])]
                if name.startswith("theta_")
                else getattr(self.state, name)
            ).copy()
            for name in names
        }


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
            f"action: found {' '.join(repr(given).split())[:80]}, expected {shape} finite numbers: "
            "changes of velocity, gain and shift in [-1, 1]"
        )
    out = np.empty(shape, dtype=np.float32)
    clip_and_round(proposed, out)
    return out


def _one_step(raw: Raw) -> Raw:
    """The integers (1, slots, k) of a step from those of each lane (k, slots)."""
    return np.ascontiguousarray(raw.T)[None]


def _uniforms(raw: Raw, draws: int) -> npt.NDArray[np.float64]:
    """Uniforms (k, draws) from integers (k, slots)."""
    u = np.empty((len(raw), draws))
    uniforms(_one_step(raw), u[None])
    return u


def _taken(state: State, which: Indices) -> State:
    """A copy of some lanes."""
    return State._make(x[which] for x in state)


def _put(state: State, which: Indices, part: State) -> None:
    """Put some lanes back, in place."""
    for x, y in zip(state, part, strict=True):
        x[which] = y
