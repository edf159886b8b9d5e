"""What is simulated: a scenario and its cells. The random numbers of an episode depend on its cell."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any

from pydantic import field_validator

from ibdata.dynamics import VARIANTS, Variant
from ibdata.experiment.dynamics import Dynamics
from ibdata.experiment.fields import Start
from ibdata.experiment.messages import refusals
from ibdata.experiment.plain import plain
from ibdata.experiment.setpoints import EpisodeCount, Seed, Setpoints, StepCount, repeated, setpoint_values
from ibdata.policies import Policy
from ibdata.policies.base import FrozenModel
from ibdata.policies.expert import Expert
from ibdata.simulation.episodes import World


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
    def points(self) -> list[float]:
        """The setpoints. If they move, these are their first values."""
        return setpoint_values(self.setpoint)[0]

    @cached_property
    def drifting(self) -> bool:
        """Whether the setpoints move."""
        return setpoint_values(self.setpoint)[1]

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
        dynamics = variant_form(self.base, self.variant)
        return tuple(
            Cell(dynamics, setpoint, self.drifting, policy, label, self.start_form)
            for label, policy in policies
            for setpoint in self.points
        )

    @field_validator("setpoint")
    @classmethod
    def _once(cls, setpoint: Any) -> Any:
        if problem := repeated(setpoint_values(setpoint)[0]):
            raise ValueError(problem)
        return setpoint


def other_dynamics(policy: Policy, scenario: Scenario) -> Iterator[str]:
    """Warnings about parts of a policy that are made for other dynamics than those of a scenario."""
    for part in policy.everywhere(Expert):
        if part.dynamics != scenario.base:
            yield (
                f"this expert is made for {part.dynamics}; for {scenario.base}, write "
                f"{{kind: expert, dynamics: {scenario.base}}}"
            )


def scenario_of(**settings: Any) -> Scenario:
    """Check the settings of a scenario. Raises ConfigError with a line `name: found, expected` for each."""
    settings = plain(settings)
    with refusals(settings, Scenario):
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
        """The canonical form, from which the digest is computed. Labels are not part of it."""
        return {
            "dynamics": self.dynamics,
            "setpoint": {"drifting": self.setpoint.hex()} if self.drifting else self.setpoint.hex(),
            "policy": self.policy.form(),
            "start": self.start,
        }

    @cached_property
    def digest(self) -> bytes:
        """SHA-256 (32 bytes) of the canonical form as JSON with sorted keys."""
        return form_digest(self.form())


def form_digest(form: Mapping[str, Any]) -> bytes:
    """SHA-256 (32 bytes) of a canonical form."""
    return hashlib.sha256(json.dumps(form, sort_keys=True).encode()).digest()


def variant_form(base: str, variant: Variant) -> Any:
    """The name `base`, with the fields in which the variant differs from the published one."""
    differing = {
        field.name: getattr(variant, field.name)
        for field in dataclasses.fields(Variant)
        if getattr(variant, field.name) != getattr(VARIANTS[base], field.name)
    }
    return {"base": base, **differing} if differing else base
