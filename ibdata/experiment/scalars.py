"""Types of the numbers and names in an experiment."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

from ibdata.policies.base import NormalSingle

MAX_SETPOINTS = 10_000


def _whole(value: Any) -> Any:
    """Accept 1e3 as a whole number; strict integers then refuse true."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _not_reserved(name: str) -> str:
    stem = name.split(".")[0]
    if stem in {"con", "prn", "aux", "nul"} or (stem[:3] in {"com", "lpt"} and stem[3:].isdigit()):
        raise ValueError(f"found {name!r}, a reserved name on some systems; choose another")
    return name


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


LICENCE = "CC-BY-4.0"  # of a dataset whose experiment names none
SPDX = r"[A-Za-z0-9(][A-Za-z0-9.+() -]{0,198}[A-Za-z0-9.+)]"
WHOLE = BeforeValidator(_whole)
Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
# -0.0 becomes 0.0, so that both have the same digest.
Setpoint = Annotated[Real, Field(ge=0.0, le=100.0), NormalSingle, AfterValidator(lambda value: value + 0.0)]
FileName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$"), AfterValidator(_not_reserved)]
Licence = Annotated[str, AfterValidator(_spdx), Field(json_schema_extra={"pattern": f"^{SPDX}$"})]
SplitName = Annotated[FileName, AfterValidator(_not_default)]
SetpointList = Annotated[list[Setpoint], Field(min_length=1, max_length=MAX_SETPOINTS)]
