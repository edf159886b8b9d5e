"""Episodes side by side: what they have in common, who acts in them, and where their random numbers are."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arrays import Floats, Ints
from ibdata._numerics.random import Purpose, Raw, integers, slots, uniforms
from ibdata.dynamics import State, Variant
from ibdata.dynamics.noise import DRIFT_SLOTS, DYNAMICS_SLOTS
from ibdata.policies import Policy
from ibdata.views.options import ViewOptions
from ibdata.views.variables import of_role, rows, variable_of

# (lanes, purpose, step, steps, slots) -> the integers (steps, slots, lanes) of `steps` steps from `step` on.
# A lane is the number of one of the episodes that are simulated side by side.
Draw = Callable[[Ints, Purpose, int, int, int], Raw]
# "default": velocity, gain and shift 50 each; "uniform" on [0, 100]; or the fewest and the most random steps.
Start = str | tuple[int, int]

NO_DRIFT_DRAWS = np.empty((0, DRIFT_SLOTS, 0), dtype=np.uint64)


@dataclasses.dataclass(frozen=True)
class World:
    """What episodes have in common."""

    variant: Variant
    start: Start = "default"
    drifting: bool = False  # whether the setpoints move

    @cached_property
    def parameters(self) -> Floats:
        """The parameters of the dynamics, as the kernel takes them."""
        return self.variant.numbers

    def integers(
        self,
        draw: Draw,
        lanes: Ints,
        step: int,
        steps: int,
        dynamics: Purpose = Purpose.DYNAMICS,
        drift: Purpose = Purpose.DRIFT,
    ) -> tuple[Raw, Raw]:
        """Draw integers (steps, 8, lanes) for the dynamics, and (steps, 4, lanes) for moving setpoints.

        For constant setpoints the second array is empty.
        """
        raw = draw(lanes, dynamics, step, steps, DYNAMICS_SLOTS)
        if not self.drifting:
            return raw, NO_DRIFT_DRAWS
        return raw, draw(lanes, drift, step, steps, DRIFT_SLOTS)


@dataclasses.dataclass(frozen=True, eq=False)
class Episodes:
    """n episodes side by side: who acts in them, and the addresses of their random numbers."""

    world: World
    policy: Policy
    label: str  # of the policy, for messages
    keys: Raw  # (n, 2), of the environment's random numbers
    policy_keys: Raw  # (n, 2), of the policy's
    index: Ints  # (n,), within their cells
    setpoint: Floats  # (n,), at the start
    number: Ints  # (n,), for messages

    def __len__(self) -> int:
        return len(self.index)

    @cached_property
    def lanes(self) -> Ints:
        """The lanes of all episodes, 0 … n - 1."""
        return np.arange(len(self))

    def played_by(self, policy: Policy, **changes: Any) -> Episodes:
        """The same episodes with another policy, and other fields if these are given."""
        return dataclasses.replace(self, **{"policy": policy, "label": policy.label, **changes})

    def take(self, lanes: Ints, **changes: Any) -> Episodes:
        """Some of the episodes, with other fields if these are given."""
        arrays = ("keys", "policy_keys", "index", "setpoint", "number")
        fields = {name: getattr(self, name)[lanes] for name in arrays}
        return dataclasses.replace(self, **{**fields, **changes})

    def draw(self, lanes: Ints, purpose: Purpose, step: int, steps: int, slots: int) -> Raw:
        """The integers (steps, slots, lanes) at the addresses of these lanes."""
        of_policy = purpose in (Purpose.POLICY, Purpose.EPISODE_POLICY)
        keys = self.policy_keys if of_policy else self.keys
        return integers(keys[lanes], self.index[lanes], purpose, step, steps, slots)


def draw_uniforms(draw: Draw, lanes: Ints, purpose: Purpose, step: int, steps: int, draws: int) -> Floats:
    """Draw numbers (steps, lanes, draws) from U(0, 1)."""
    u = np.empty((steps, len(lanes), draws))
    uniforms(draw(lanes, purpose, step, steps, slots(draws)), u)
    return u


FloatTable = npt.NDArray[np.floating[Any]]  # (columns, rows), float32 or float64


def hidden_variables(drifting: bool) -> tuple[str, ...]:
    """The variables of the Markov state that are not observed."""
    return of_role("latent", "drift") if drifting else of_role("latent")


def observed_rows(view: ViewOptions, drifting: bool) -> npt.NDArray[np.int64]:
    """The rows of the variables that a view observes."""
    return record_rows([variable_of(name) for name in view.columns(drifting)])


def values_of(state: State, which: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
    """The values of variables in a state of n lanes, (n, rows), as a dataset holds them."""
    values: npt.NDArray[np.float32] = (state.values[which].T + 0.0).astype(np.float32)
    return values


def record_rows(names: Sequence[str]) -> npt.NDArray[np.int64]:
    """The rows (k,) of variables in a state."""
    return np.array(rows(*names), dtype=np.int64)
