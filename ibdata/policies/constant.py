"""The same action at every step."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, Field

from ibdata.policies.base import Deterministic, Floats, History, NormalSingle

Component = Annotated[
    float, Field(ge=-1.0, le=1.0, strict=True), NormalSingle, AfterValidator(lambda value: value + 0.0)
]


class Constant(Deterministic):
    """Takes the same action (Δv, Δg, Δh) at every step, by default zero."""

    history_length: ClassVar[int] = 0

    kind: Literal["constant"] = "constant"
    action: tuple[Component, Component, Component] = Field(
        default=(0.0, 0.0, 0.0), description="(Δv, Δg, Δh), each in [-1, 1]"
    )

    def act(self, history: History, u: Floats) -> npt.ArrayLike:
        return np.tile(np.array(self.action), (len(history), 1))
