"""What is simulated: dynamics, a scenario and its cells, on which the random numbers of episodes depend."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from pydantic import AfterValidator, Field, Tag, create_model, field_validator

from ibdata._simulation.episodes import World
from ibdata.dynamics import VARIANTS, Variant
from ibdata.dynamics.variants import FIELDS, Declared
from ibdata.experiment.fields import (
    Drifting,
    EpisodeCount,
    Real,
    Seed,
    Setpoints,
    Start,
    StepCount,
    by_type,
    points_of,
    repeated,
)
from ibdata.experiment.messages import refusals, shown
from ibdata.policies import Policy
from ibdata.policies.base import FROM_FLOAT, FrozenModel
from ibdata.policies.expert import Expert
from ibdata.policies.user_object import ObjectPolicy


class ReplacedFields(FrozenModel):
    """Base of `CustomDynamics`, which adds an optional field for each field of `Variant`."""

    base: Literal["siemens", "paper"]

    def variant(self) -> Variant:
        """The variant. Raises ValueError if its fields are invalid."""
        replaced = {name: value for name, value in self if name in FIELDS and value is not None}
        return dataclasses.replace(VARIANTS[self.base], **replaced)


def _allowed(declared: Declared) -> AfterValidator:
    """A validator of a field of `Variant`."""

    def check(value: Any) -> Any:
        if not declared.allows(value):
            raise ValueError(f"found {shown(value)}, expected it to {declared.rule}")
        return value

    return AfterValidator(check)


def _strict(hint: Any, bounds: Any) -> Any:
    """The type of a field of `Variant`, with strict numbers as in the other models."""
    if get_origin(hint) is tuple:
        return tuple[tuple(_strict(part, bounds) for part in get_args(hint))]  # type: ignore[misc]  # at run time
    kinds = {float: Annotated[Real, bounds], int: Annotated[int, Field(strict=True), bounds, FROM_FLOAT]}
    return kinds[hint]


CustomDynamics = create_model(
    "CustomDynamics",
    __base__=ReplacedFields,
    __doc__="A published variant with single fields replaced.",
    **{
        name: (
            Annotated[_strict(hint, Field(**declared.limits)), _allowed(declared)] | None,
            Field(default=None, description=f"paper: {declared.paper}; siemens: {declared.siemens}"),
        )
        for (name, declared), hint in zip(FIELDS.items(), get_type_hints(Variant).values(), strict=True)
    },
)  # type: ignore[call-overload]  # the fields are those of Variant, known at run time only

Dynamics = Annotated[
    Annotated[Literal["siemens", "paper"], Tag("<word>")] | Annotated[CustomDynamics, Tag("<mapping>")],
    by_type("<word>", "<mapping>"),
]


class Scenario(FrozenModel):
    """What is simulated: so many episodes at each setpoint. It says nothing of policies, YAML or files."""

    dynamics: Dynamics = "siemens"
    setpoint: Setpoints = 70.0
    start: Start = "default"
    steps: StepCount = 1000
    episodes: EpisodeCount = 1
    seed: Seed = 0

    @cached_property
    def variant(self) -> Variant:
        """The dynamics as a variant."""
        return VARIANTS[self.dynamics] if isinstance(self.dynamics, str) else self.dynamics.variant()

    @property
    def base(self) -> str:
        """The name of the published dynamics. The scenario may replace single fields of them."""
        return self.dynamics if isinstance(self.dynamics, str) else self.dynamics.base

    @cached_property
    def replaced(self) -> dict[str, Any]:
        """The fields of the dynamics that differ from the published ones of that name."""
        values, published = vars(self.variant), vars(VARIANTS[self.base])
        return {name: values[name] for name in FIELDS if values[name] != published[name]}

    @property
    def expert(self) -> Expert:
        """The expert that is made for the published dynamics of that name."""
        return Expert(dynamics=self.base)

    @cached_property
    def points(self) -> list[float]:
        """The setpoints. If they move, these are their first values."""
        return points_of(self.setpoint)

    @cached_property
    def drifting(self) -> bool:
        """Whether the setpoints move."""
        return self.setpoint == "drifting" or isinstance(self.setpoint, Drifting)

    @cached_property
    def world(self) -> World:
        """What all episodes have in common, for the simulation."""
        start = self.start if isinstance(self.start, str) else self.start.steps
        return World(self.variant, start, self.drifting)

    @property
    def start_form(self) -> Any:
        """The start as plain data."""
        return self.start if isinstance(self.start, str) else self.start.model_dump()

    def cells(self, policies: Iterable[tuple[str, Policy]]) -> tuple[Cell, ...]:
        """The cells of these policies and labels, ordered by policy and then by setpoint."""
        dynamics = {"base": self.base, **self.replaced} if self.replaced else self.base
        return tuple(
            Cell(dynamics, setpoint, self.drifting, policy, label, self.start_form)
            for label, policy in policies
            for setpoint in self.points
        )

    @field_validator("setpoint")
    @classmethod
    def _once(cls, setpoint: Any) -> Any:
        if problem := repeated(points_of(setpoint)):
            raise ValueError(problem)
        return setpoint


def other_dynamics(policy: Policy, scenario: Scenario) -> Iterator[str]:
    """Warnings about parts of a policy that are made for other dynamics than those of a scenario."""
    replaced = ", ".join(f"{name} = {shown(value)}" for name, value in scenario.replaced.items())
    for part in policy.everywhere(Expert):
        if part.dynamics != scenario.base:
            yield (
                f"this expert is made for {part.dynamics}; for {scenario.base}, write "
                f"{{kind: expert, dynamics: {scenario.base}}}"
            )
        elif replaced:
            yield f"this expert is made for {part.dynamics} as published, but here {replaced}"


def scenario_of(**settings: Any) -> Scenario:
    """Check the settings of a scenario. Raises ConfigError with a line `name: found, expected` for each."""
    with refusals(settings, Scenario) as settings:
        return Scenario.model_validate(settings)


@dataclasses.dataclass(frozen=True)
class Cell:
    """One combination of dynamics, setpoint, policy and start."""

    dynamics: Any
    setpoint: float
    drifting: bool
    policy: Policy
    label: str
    start: Any

    def form(self) -> dict[str, Any]:
        """The canonical form, from which the digest is computed. A label is part of it for objects only."""
        is_object = any(self.policy.everywhere(ObjectPolicy))  # two of one class draw apart
        return {
            "dynamics": self.dynamics,
            "setpoint": {"drifting": self.setpoint.hex()} if self.drifting else self.setpoint.hex(),
            "policy": self.policy.form(),
            "start": self.start,
            **({"label": self.label} if is_object else {}),
        }

    @cached_property
    def digest(self) -> bytes:
        """SHA-256 (32 bytes) of the canonical form as JSON with sorted keys."""
        return form_digest(self.form())


def form_digest(form: Mapping[str, Any]) -> bytes:
    """SHA-256 (32 bytes) of a canonical form."""
    return hashlib.sha256(json.dumps(form, sort_keys=True).encode()).digest()
