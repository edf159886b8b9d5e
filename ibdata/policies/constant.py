"""The same action at every step."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field

from ibdata.policies.base import Decision, Deterministic, Needs, Observed

Component = Annotated[float, Field(ge=-1.0, le=1.0, strict=True), AfterValidator(lambda value: value + 0.0)]


class Constant(Deterministic):
    """Takes the same action (Δv, Δg, Δh) at every step, by default zero."""

    needs: ClassVar[Needs] = Needs(history=0)

    kind: Literal["constant"] = "constant"
    action: tuple[Component, Component, Component] = Field(
        default=(0.0, 0.0, 0.0), description="(Δv, Δg, Δh), each in [-1, 1]"
    )

    def decide(self, observed: Observed) -> Decision:
        return Decision(np.tile(np.array(self.action), (len(observed.step), 1)), observed.memory)
