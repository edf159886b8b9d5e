"""Numbers and names in an experiment, and its setpoints: a number, a list, a range, or moving ones."""

from __future__ import annotations

import math
import re
from fractions import Fraction
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from ibdata.errors import suggestion
from ibdata.experiment.messages import shown
from ibdata.numerics.naming import exact
from ibdata.policies.base import FrozenModel

MAX_SETPOINTS = 10_000


def _whole(value: Any) -> Any:
    """Accept 1e3 as a whole number. Strict integers then refuse true."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _not_default(name: str) -> str:
    if name == "default":
        raise ValueError("found 'default', the name of the whole dataset; choose another")
    return name


def _spdx(text: str) -> str:
    if not re.fullmatch(SPDX, text):
        raise ValueError(
            f"found {text[:60]!r}, expected an SPDX expression such as {LICENCE} or 'MIT OR Apache-2.0': "
            "2 to 200 letters, digits, spaces and . + - ( )"
        )
    return text


LICENCE = "CC-BY-4.0"  # the licence where an experiment names none
SPDX = r"[A-Za-z0-9(][A-Za-z0-9.+() -]{0,198}[A-Za-z0-9.+)]"
WHOLE = BeforeValidator(_whole)
Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
# -0.0 becomes 0.0, so that both have the same digest.
Setpoint = Annotated[Real, Field(ge=0.0, le=100.0), AfterValidator(lambda value: value + 0.0)]
EpisodeCount = Annotated[int, Field(strict=True, ge=1, lt=2**48), WHOLE]
StepCount = Annotated[int, Field(strict=True, ge=1, lt=2**31), WHOLE]
Seed = Annotated[int, Field(strict=True, ge=0, lt=2**64), WHOLE]
FileName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$")]
Licence = Annotated[str, AfterValidator(_spdx), Field(json_schema_extra={"pattern": f"^{SPDX}$"})]
SplitName = Annotated[FileName, AfterValidator(_not_default)]
SetpointList = Annotated[list[Setpoint], Field(min_length=1, max_length=MAX_SETPOINTS)]


def by_form(*forms: str) -> Discriminator:
    """Choose the branch of a union by the form of a value. Any other form gets the first branch."""

    def form(value: Any) -> str:
        if isinstance(value, dict | FrozenModel):
            name = "<mapping>"
        elif isinstance(value, list):
            name = "<list>"
        else:
            name = "<word>" if isinstance(value, str) else "<number>"
        return name if name in forms else forms[0]

    return Discriminator(form)


class SetpointRange(FrozenModel):
    """The setpoints start, start + step, … up to stop, which is included."""

    start: Setpoint
    stop: Setpoint
    step: Annotated[Real, Field(gt=0.0)]

    def values(self) -> list[float]:
        """The setpoints of the range."""
        # Fractions of the written decimals are exact: 0.1 · 3 is 0.3, and no setpoint exceeds the stop.
        start, stop, step = (Fraction(repr(number)) for number in (self.start, self.stop, self.step))
        return [float(start + i * step) for i in range(math.floor((stop - start) / step) + 1)]

    @model_validator(mode="after")
    def _check(self) -> SetpointRange:
        if self.stop < self.start:
            raise ValueError(
                f"found stop {exact(self.stop)} below start {exact(self.start)}, expected at least start"
            )
        if (self.stop - self.start) / self.step >= MAX_SETPOINTS:
            raise ValueError(f"found more than {MAX_SETPOINTS} setpoints, expected at most {MAX_SETPOINTS}")
        return self


SetpointOrList = Annotated[
    Annotated[Setpoint, Tag("<number>")] | Annotated[SetpointList, Tag("<list>")],
    by_form("<number>", "<list>"),
]


class Drifting(FrozenModel):
    """Moving setpoints, given by their first values."""

    drifting: SetpointOrList

    def values(self) -> list[float]:
        """The first setpoints."""
        return self.drifting if isinstance(self.drifting, list) else [self.drifting]


def _drifting(value: Any) -> Any:
    if isinstance(value, str) and value != "drifting":
        raise ValueError(
            f"found {shown(value)}, expected a number, a list, {{start, stop, step}} or drifting"
            f"{suggestion(value, ['drifting'])}"
        )
    return value


Setpoints = Annotated[
    Annotated[Setpoint, Tag("<number>")]
    | Annotated[Literal["drifting"], BeforeValidator(_drifting), Tag("<word>")]
    | Annotated[SetpointList, Tag("<list>")]
    | Annotated[
        Annotated[Drifting, Tag("<drifting>")] | Annotated[SetpointRange, Tag("<range>")],
        Discriminator(lambda x: "<drifting>" if isinstance(x, Drifting) or "drifting" in x else "<range>"),
        Tag("<mapping>"),
    ],
    by_form("<number>", "<word>", "<list>", "<mapping>"),
]


def repeated(points: list[float]) -> str | None:
    """The problem if a setpoint occurs twice; None otherwise."""
    seen: set[float] = set()
    for point in points:
        if point in seen:
            return f"found {exact(point)} twice, expected each setpoint once"
        seen.add(point)
    return None


def setpoint_values(setpoints: Any) -> tuple[list[float], bool]:
    """The setpoints in order, and whether they move.

    >>> setpoint_values("drifting"), setpoint_values(70.0)
    (([50.0], True), ([70.0], False))
    """
    if setpoints == "drifting":
        return [50.0], True
    if isinstance(setpoints, Drifting | SetpointRange):
        return setpoints.values(), isinstance(setpoints, Drifting)
    return (setpoints if isinstance(setpoints, list) else [setpoints]), False
