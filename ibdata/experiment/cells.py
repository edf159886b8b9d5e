"""Cells, the parts of an experiment on which the random numbers of an episode depend."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from functools import cached_property
from typing import Any

from ibdata.dynamics import VARIANTS, Variant
from ibdata.policies import Policy


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
    """The name `base`, with those fields of the variant that differ from the published one of that name."""
    differing = {
        field.name: getattr(variant, field.name)
        for field in dataclasses.fields(Variant)
        if getattr(variant, field.name) != getattr(VARIANTS[base], field.name)
    }
    return {"base": base, **differing} if differing else base
