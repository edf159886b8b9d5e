"""The options of a view, as users give them."""

from __future__ import annotations

import copy
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arguments import public
from ibdata._numerics.arrays import Float32s
from ibdata.errors import UsageError, suggestion
from ibdata.views.imperfections import KINDS, NONE, Imperfections, Measurement, imperfections_of
from ibdata.views.rewards import CLASSIC, Cost, Reward, cost_of, reward_of
from ibdata.views.variables import VARIABLES, of_role, variable_of

ACTIONS = ("act_velocity", "act_gain", "act_shift")
OBSERVED = tuple(f"obs_{name}" for name in of_role("observation"))
NAMED = ("classic", "markov")
EXPECTED = "classic, markov or a list of columns"
COLUMNS = (*OBSERVED, *(f"latent_{name}" for name in of_role("latent", "drift", "derived")))


# The options of a view by name, see `view_options`; None: the plain view.
View = Annotated[Mapping[str, Any] | None, "a mapping such as {'observe': 'markov'}"]


@dataclass(frozen=True)
class ViewOptions:
    """The observed columns and the reward of a view.

    A frame holds the numbers of one step. First come the observed columns. With the option `mask`, a flag
    follows for each column that may be missing. With `actions`, the action of the step before comes last.
    """

    observe: str | tuple[str, ...] = "classic"
    actions: bool = False
    reward: Reward = CLASSIC
    reward_scale: float = 1.0
    imperfections: Imperfections = NONE
    cost: Cost | None = None

    @property
    def is_classic(self) -> bool:
        """Whether the frames are the six observed variables, without imperfections and actions."""
        return self.observe in ("classic", OBSERVED) and not self.actions and not self.imperfections.columns

    def columns(self, drifting: bool) -> tuple[str, ...]:
        """The observed columns. They depend on whether the setpoints move."""
        if self.observe == "classic":
            return OBSERVED
        if self.observe == "markov":
            hidden = of_role("latent", "drift") if drifting else of_role("latent")
            return (*OBSERVED, *(f"latent_{name}" for name in hidden))
        return tuple(self.observe)

    def flagged(self, drifting: bool) -> tuple[str, ...]:
        """The columns with a flag that says whether the value is missing."""
        if not self.imperfections.mask:
            return ()
        return tuple(name for name in self.columns(drifting) if self.imperfections.missing.get(name))

    def frame(self, drifting: bool) -> tuple[str, ...]:
        """The names of the numbers of a frame, in their order."""
        flags = (f"missing_{name}" for name in self.flagged(drifting))
        return (*self.columns(drifting), *flags, *(f"previous_{name}" for name in ACTIONS if self.actions))

    def changed(self) -> dict[str, Any]:
        """The options that differ from those of the plain view, as JSON data for `view_of`."""
        return {
            name: option.plain() if isinstance(option, Reward | Imperfections | Cost) else option
            for name, option in vars(self).items()
            if option != getattr(PLAIN, name)
        }

    def plain(self, drifting: bool) -> dict[str, Any]:
        """The view as JSON data, as exports keep it."""
        return {
            "frame": list(self.frame(drifting)),
            "reward": self.reward.plain(),
            "reward_scale": self.reward_scale,
            "imperfections": self.imperfections.plain(),
            **({} if self.cost is None else {"cost": self.cost.plain()}),
        }


PLAIN = ViewOptions()


def view_of(view: View) -> ViewOptions:
    """Check the argument `view`. Raises UsageError if an option is unknown or not valid."""
    return PLAIN if view is None else view_options(**{str(name): value for name, value in view.items()})


@public
def view_options(
    observe: str | Sequence[str] = "classic",
    actions: bool = False,
    reward: str | Mapping[str, float] = "classic",
    reward_scale: float = 1.0,
    imperfections: Mapping[str, Any] | None = None,
    cost: str | Mapping[str, Any] | None = None,
) -> ViewOptions:
    """Check the options of a view.

    Args:
        observe: "classic" for the six observed variables, "markov" for the whole state (20 columns, or 22
            with moving setpoints), or a list of columns `obs_…` and `latent_…`.
        actions: whether each frame also has the action of the step before, zero at the first step.
        reward: "classic" for the reward of the benchmark, "delta" for its change since the step before, or
            the weights of consumption and fatigue, such as {"consumption": 1, "fatigue": 3}.
        reward_scale: the factor of the reward.
        imperfections: a mapping with some of the keys `delay`, `noise`, `quantise` and `missing`, each a
            mapping of columns to numbers; `mask`, whether flags tell which values are missing; and `seed`.
        cost: a cost beside the reward: {"fatigue": 60} is 1 for each step to a fatigue above 60, "runaway"
            for each to a hidden μ of at least 1.2, from where it grows by itself. With `budget`, such as
            {"fatigue": 60, "budget": 25}, an evaluation counts the episodes whose costs add up to more.

    Raises:
        UsageError: an option is invalid.
    """
    if not 0 < reward_scale <= sys.float_info.max:
        raise UsageError(f"reward_scale: found {reward_scale!r}, expected a finite number above 0")
    options = ViewOptions(
        _observed(observe),
        actions,
        reward_of(reward),
        float(reward_scale),
        imperfections_of(imperfections),
        cost_of(cost),
    )
    known = options.columns(drifting=True)
    for name in options.imperfections.columns:
        if name not in known:
            hint = suggestion(name, known)
            raise UsageError(f"imperfections: found {name!r}, expected one of the observed columns{hint}")
    return options


def _observed(observe: str | Sequence[str]) -> str | tuple[str, ...]:
    """Check the option `observe`."""
    if isinstance(observe, str) and observe in NAMED:
        return observe
    if isinstance(observe, str):
        raise UsageError(f"observe: found {observe!r}, expected {EXPECTED}{suggestion(observe, NAMED)}")
    names = tuple(observe)
    if not names or len(set(names)) < len(names):
        raise UsageError(f"observe: found {observe!r}, expected {EXPECTED}")
    for name in names:
        if name not in COLUMNS:
            hint = suggestion(name, COLUMNS)
            raise UsageError(f"observe: found {name!r}, expected columns obs_… or latent_…{hint}")
    return names


def bounds_of(
    options: ViewOptions, drifting: bool, consumption: tuple[float | None, float | None] = (None, None)
) -> list[tuple[float | None, float | None]]:
    """The lowest and the highest value of each number of a frame; None where there is no bound.

    The bounds of the consumption depend on the variant of the dynamics.
    """
    bounds: list[tuple[float | None, float | None]] = []
    for name in options.columns(drifting):
        variable = VARIABLES[variable_of(name)]
        exact = consumption if name == "obs_consumption" else (variable.low, variable.high)
        troubles = [kind for kind in KINDS if name in getattr(options.imperfections, kind)]
        bounds.append(exact if all(KINDS[kind][-1] for kind in troubles) else (None, None))
    flags, actions = len(options.flagged(drifting)), len(ACTIONS) * options.actions
    return [*bounds, *[(0.0, 1.0)] * flags, *[(-1.0, 1.0)] * actions]


Indices = npt.NDArray[np.int64]


# Steps of a burn-in: which episodes made it (k,), their values before it (k, columns), their actions (k, 3).
BurnIn = Sequence[tuple[Indices, Float32s, Float32s]]


class Window:
    """The last `history` frames of n lanes through a view. Before the first one, that one is repeated."""

    def __init__(
        self, options: ViewOptions, drifting: bool, n: int, history: int, burn_in: bool = False
    ) -> None:
        columns = options.columns(drifting)
        self._of_burn_in = partial(Window, options, drifting, history=history, burn_in=True)
        self._measurement = Measurement(options.imperfections, columns, burn_in)
        self._flagged = [columns.index(name) for name in options.flagged(drifting)]
        self._actions = options.actions
        self._numbers, self._times = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
        max_delay = int(self._measurement.delay.max())
        self._clean = np.zeros((n, max_delay + 1, len(columns)), dtype=np.float32)  # newest first
        self._arrived = np.zeros((n, len(columns)), dtype=np.float32)
        self.frames = np.zeros((n, history, len(options.frame(drifting))), dtype=np.float32)

    def begin(self, lanes: Indices, clean: Float32s, numbers: Indices, burn_in: BurnIn = ()) -> None:
        """Begin episodes with these numbers (k,) and true values `clean` (k, columns), after a burn-in."""
        self._numbers[lanes], self._times[lanes] = numbers, 0
        self._clean[lanes] = clean[:, None]
        actions = np.zeros((len(lanes), len(ACTIONS)), dtype=np.float32)
        self.frames[lanes] = self._frame(lanes, actions)[:, None]
        if burn_in:
            some, first, _ = burn_in[0]
            past = self._of_burn_in(n=len(lanes))
            past.begin(some, first, numbers[some])
            for (before, _, actions), (which, values, _) in pairwise(burn_in):
                past.push(which, values, actions[np.isin(before, which)])
            self.frames[lanes[some], 1:] = past.frames[some, :-1]

    def take(self, lanes: Indices, times: Indices, numbers: Indices | None) -> Window:
        """A copy of some lanes, which go on at these times, as episodes with other numbers if given (k,)."""
        taken = copy.copy(self)
        taken._clean, taken._arrived, taken.frames = (
            array[lanes] for array in (self._clean, self._arrived, self.frames)
        )
        taken._times, taken._numbers = times.copy(), self._numbers[lanes] if numbers is None else numbers
        return taken

    def push(self, lanes: Indices, clean: Float32s, actions: Float32s) -> None:
        """Add the frame of some lanes after a step with the actions (k, 3)."""
        self._times[lanes] += 1
        self._clean[lanes, 1:] = self._clean[lanes, :-1]
        self._clean[lanes, 0] = clean
        self.frames[lanes, 1:] = self.frames[lanes, :-1]
        self.frames[lanes, 0] = self._frame(lanes, actions)

    def _frame(self, lanes: Indices, actions: Float32s) -> Float32s:
        """The newest frame of some lanes."""
        delay = self._measurement.delay
        delayed = self._clean[lanes[:, None], delay, np.arange(len(delay))]
        lost = np.zeros(delayed.shape, dtype=bool)
        arrived = delayed
        for time in np.unique(self._times[lanes]).tolist():  # lanes at one time are measured together
            rows = np.flatnonzero(self._times[lanes] == time)
            numbers = self._numbers[lanes[rows]]
            arrived[rows], lost[rows] = self._measurement.step(delayed[rows], numbers, time)
        self._arrived[lanes] = np.where(lost, self._arrived[lanes], arrived)
        parts = [self._arrived[lanes], lost[:, self._flagged], actions[:, : len(ACTIONS) * self._actions]]
        return np.concatenate(parts, axis=1, dtype=np.float32)
