"""The settings of an environment, with the values that experiments and views take."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from inspect import signature
from typing import Any

from ibdata._numerics.arguments import public
from ibdata._simulation.episodes import World
from ibdata.dataset.selection import checked_length
from ibdata.dynamics import Variant
from ibdata.dynamics.consumption import PENALTY_WEIGHT
from ibdata.errors import UsageError, excerpt
from ibdata.experiment.scenario import scenario_of
from ibdata.views.options import View, ViewOptions, bounds_of, view_of
from ibdata.views.variables import COST_MAX, M_MAX, M_MIN, VARIABLES, variable_of

Z_MAX = 8.21  # the normal draw is at most Φ⁻¹(1 - 2⁻⁵³) ≈ 8.2095


@dataclasses.dataclass(frozen=True)
class Settings:
    """The settings of an environment."""

    world: World
    setpoint: float  # before the first step
    history: int  # observations that are returned together
    view: ViewOptions
    discrete_actions: bool


@partial(public, unknown="got an unexpected keyword argument {!r}")  # libraries look for Python's words
def settings(
    setpoint: Any = 70.0,
    dynamics: Any = "siemens",
    start: Any = "default",
    history: int = 1,
    discrete_actions: bool = False,
    view: View = None,
) -> Settings:
    """Check the settings of an environment.

    Raises:
        ConfigError: setpoint, dynamics or start are invalid; each has a line.
        UsageError: another setting is invalid.
    """
    if isinstance(dynamics, Variant):
        dynamics = {"base": "siemens", **dataclasses.asdict(dynamics)}
    scenario = scenario_of(setpoint=setpoint, dynamics=dynamics, start=start)
    first, *others = scenario.points
    if others:
        raise UsageError(f"setpoint: found {excerpt(setpoint)}, expected one, or one that moves")
    world, options = scenario.world, view_of(view)
    for name in options.columns(world.drifting):
        if VARIABLES[variable_of(name)].role == "drift" and not world.drifting:
            raise UsageError(f"observe: found {name}, which only a moving setpoint has; leave it out")
    return Settings(world, first, checked_length(history), options, discrete_actions)


SETTINGS = signature(settings).parameters.keys()


class Fixed:
    """What has the settings with which it was made. A subclass may have attributes of their names."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name in SETTINGS and type(self).__module__.startswith(__package__):
            raise UsageError(f"{name}: found a new value, expected it where an environment is made: {name}=…")
        super().__setattr__(name, value)


def consumption_bounds(variant: Variant) -> tuple[float, float]:
    """The lowest and the highest possible consumption.

    c = ĉ + (1 + k ĉ) z is linear in ĉ and in z, so its extremes are at those of both: z in ±8.21, and
    ĉ = θᶜ + 25 (m + offset) with θᶜ in [Σw, 4915 Σw] and the penalty m in its bounds.

    >>> from ibdata.dynamics import SIEMENS
    >>> [round(bound, 1) for bound in consumption_bounds(SIEMENS)]
    [-7.3, 5183.2]
    """
    weight, k = sum(variant.convolution_weights), variant.consumption_noise
    low = weight + PENALTY_WEIGHT * (M_MIN + variant.consumption_offset)
    high = COST_MAX * weight + PENALTY_WEIGHT * (M_MAX + variant.consumption_offset)
    corners = [c + (1.0 + k * c) * z for c in (low, high) for z in (-Z_MAX, Z_MAX)]
    return min(corners), max(corners)


def frame_bounds(settings: Settings) -> tuple[list[float], list[float]]:
    """The lowest and the highest values of a frame, in its order; infinite where there is no bound."""
    world = settings.world
    bounds = bounds_of(settings.view, world.drifting, consumption_bounds(world.variant))
    low, high = zip(*bounds, strict=True)
    return [-math.inf if x is None else x for x in low], [math.inf if x is None else x for x in high]
