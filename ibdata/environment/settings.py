"""The settings of an environment: setpoint, dynamics, start, length of history, and what is seen of it."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError

from ibdata.dynamics import VARIANTS, Variant
from ibdata.dynamics.consumption import PENALTY_WEIGHT
from ibdata.environment import ID
from ibdata.errors import ConfigError, UsageError, suggestion
from ibdata.experiment.dynamics import Dynamics
from ibdata.experiment.fields import Start
from ibdata.experiment.messages import problems, shown
from ibdata.experiment.scalars import WHOLE, Real
from ibdata.experiment.setpoints import Setpoints, setpoint_values
from ibdata.policies.base import FrozenModel
from ibdata.variables import VARIABLES, variable_of
from ibdata.views.options import ViewOptions, bounds_of, view_options

MAX_FRAMES = 1000
Z_MAX = 8.21  # the normal draw is at most Φ⁻¹(1 - 2⁻⁵³) ≈ 8.2095
COST_MAX = 4915.0  # θ <= e^8.5 ≈ 4914.8
M_MIN, M_MAX = -1.001, 1.24  # the penalty m, see `VARIABLES`


def _number(value: Any) -> Any:
    """Turn a NumPy number into one of Python."""
    return value.item() if isinstance(value, np.generic) else value


def _one(value: Any) -> Any:
    """Refuse more than one setpoint."""
    start = value.get("drifting") if isinstance(value, dict) else value
    if value != "drifting" and not isinstance(start, float | int | np.number):
        near = suggestion(value, ["drifting"]) if isinstance(value, str) else ""
        raise ValueError(f"found {shown(value)}, expected a number, drifting or {{drifting: a number}}{near}")
    return _number(value)


def _as_mapping(value: Any) -> Any:
    """A variant in the form that an experiment's YAML has."""
    return {"base": "siemens", **dataclasses.asdict(value)} if isinstance(value, Variant) else value


class Settings(FrozenModel):
    """The settings of an environment, with the values that experiments take."""

    setpoint: Annotated[Setpoints, BeforeValidator(_one)] = 50.0
    dynamics: Annotated[Dynamics, BeforeValidator(_as_mapping)] = "siemens"
    start: Start = "default"
    history: Annotated[int, Field(strict=True, ge=1, le=MAX_FRAMES), WHOLE, BeforeValidator(_number)] = 1
    reward_scale: Annotated[Real, Field(gt=0.0), BeforeValidator(_number)] = 1.0
    observe: Any = "classic"
    actions: Any = False
    reward: Any = "classic"
    imperfections: Any = None
    discrete_actions: Annotated[bool, Field(strict=True), BeforeValidator(_number)] = False

    @cached_property
    def variant(self) -> Variant:
        """The dynamics as a variant."""
        return VARIANTS[self.dynamics] if isinstance(self.dynamics, str) else self.dynamics.variant()

    @cached_property
    def view(self) -> ViewOptions:
        """What is seen and rewarded. Raises UsageError if an option of the view is invalid."""
        options = view_options(self.observe, self.actions, self.reward, self.reward_scale, self.imperfections)
        for name in options.columns(self.drifting):
            if VARIABLES[variable_of(name)].role == "drift" and not self.drifting:
                raise UsageError(f"observe: found {name}, which only a moving setpoint has; leave it out")
        return options

    @cached_property
    def first_setpoint(self) -> float:
        """The setpoint before the first step."""
        return setpoint_values(self.setpoint)[0][0]

    @cached_property
    def drifting(self) -> bool:
        """Whether the setpoint moves."""
        return setpoint_values(self.setpoint)[1]


def settings(**given: Any) -> Settings:
    """Check the settings given. Raises ConfigError with a line for each that is invalid, or UsageError."""
    try:
        made = Settings.model_validate(given)
    except ValidationError as error:
        found = problems(error, Settings, given)
        raise ConfigError([f"{ID}: {problem.key}: {problem.message}" for problem in found]) from None
    made.view  # noqa: B018  # refuses an invalid one
    return made


def consumption_bounds(variant: Variant) -> tuple[float, float]:
    """Return the lowest and the highest possible consumption.

    c = ĉ + (1 + k ĉ) z is linear in ĉ and in z, so its extremes are at those of both: z in ±8.21, and
    ĉ = θᶜ + 25 (m + offset) with θᶜ in [Σw, 4915 Σw] and the penalty m in its bounds.

    >>> [round(bound, 1) for bound in consumption_bounds(VARIANTS["siemens"])]
    [-7.3, 5183.2]
    """
    weight, k = sum(variant.convolution_weights), variant.consumption_noise
    low = weight + PENALTY_WEIGHT * (M_MIN + variant.consumption_offset)
    high = COST_MAX * weight + PENALTY_WEIGHT * (M_MAX + variant.consumption_offset)
    corners = [c + (1.0 + k * c) * z for c in (low, high) for z in (-Z_MAX, Z_MAX)]
    return min(corners), max(corners)


def frame_bounds(settings: Settings) -> tuple[list[float], list[float]]:
    """The lowest and the highest values of a frame, in its order; infinite where there is no bound."""
    bounds = bounds_of(settings.view, settings.drifting, consumption_bounds(settings.variant))
    low, high = zip(*bounds, strict=True)
    return [-math.inf if x is None else x for x in low], [math.inf if x is None else x for x in high]
