"""Types of the numbers and names in an experiment, and the choice between forms of a value."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field

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
