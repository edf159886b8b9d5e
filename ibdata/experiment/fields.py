"""Start, output and splits of an experiment."""

from __future__ import annotations

import re
from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, Tag

from ibdata.experiment.messages import shown
from ibdata.experiment.setpoints import WHOLE, SetpointOrList, by_form
from ibdata.policies.base import FrozenModel


def _ordered(pair: list[int]) -> list[int]:
    """Check that the first of two numbers is not the greater one."""
    if pair[1] < pair[0]:
        raise ValueError(f"found {pair}, expected [fewest, most] steps in this order")
    return pair


class BurnIn(FrozenModel):
    """A random number of steps with uniform random actions, which policies see but which are not recorded."""

    burn_in: Annotated[
        list[Annotated[int, Field(strict=True, ge=0, le=100_000), WHOLE]],
        Field(min_length=2, max_length=2),
        AfterValidator(_ordered),
    ] = Field(description="[fewest, most] steps; all numbers between them are equally likely")

    @property
    def steps(self) -> tuple[int, int]:
        """The fewest and the most steps."""
        fewest, most = self.burn_in
        return fewest, most


Start = Annotated[
    Annotated[Literal["default", "uniform"], Tag("<word>")] | Annotated[BurnIn, Tag("<mapping>")],
    by_form("<word>", "<mapping>"),
]


class Output(FrozenModel):
    """How the dataset is stored. The simulation does not depend on it."""

    dtype: Literal["float32", "float64"] = Field(
        default="float32", description="type of all float columns; actions are float32 values in both"
    )
    latent: Literal[False, True, "full", "next"] = Field(
        default=True, description="Markov state at t; full: with derived values; next: with that at t + 1"
    )
    shard_rows: Annotated[int, Field(strict=True, ge=1, le=100_000_000), WHOLE] = Field(
        default=1_000_000, description="most rows of a file, which holds whole episodes and at least one"
    )


class EpisodeRange(FrozenModel):
    """Episodes of each cell by their index, which begins at 0; the stop is included."""

    start: Annotated[int, Field(strict=True, ge=0), WHOLE] = Field(default=0, description="the first")
    stop: Annotated[int, Field(strict=True, ge=0), WHOLE] = Field(description="the last")


SHARE = re.compile(r"(first|last) ([1-9][0-9]?) ?%")
SCHEMA: dict[str, Any] = {"pattern": f"^{SHARE.pattern}$"}


def _share(value: str) -> str:
    """Check a share of the episodes of each cell, such as `first 90%`."""
    if not SHARE.fullmatch(value):
        raise ValueError(
            f"found {shown(value)}, expected a whole number, {{start, stop}}, or a share such as first 90%"
        )
    return value


class Split(FrozenModel):
    """The episodes that meet all of these conditions."""

    setpoint: SetpointOrList | None = Field(default=None, description="one or a list; default: all")
    policy: (
        Annotated[
            Annotated[str, Tag("<word>")] | Annotated[list[str], Field(min_length=1), Tag("<list>")],
            by_form("<word>", "<list>"),
        ]
        | None
    ) = Field(default=None, description="a label or a list; default: all")
    episodes: (
        Annotated[
            Annotated[Annotated[int, Field(strict=True, ge=1), WHOLE], Tag("<number>")]
            | Annotated[EpisodeRange, Tag("<mapping>")]
            | Annotated[str, AfterValidator(_share), Field(json_schema_extra=SCHEMA), Tag("<word>")],
            by_form("<number>", "<mapping>", "<word>"),
        ]
        | None
    ) = Field(
        default=None,
        description="how many of each cell, {start, stop}, first 90%, or last 10%; default: all",
    )
    overlap: bool = Field(default=False, strict=True, description="may share episodes with other splits")

    def setpoints(self) -> list[float] | None:
        """The selected setpoints, or None for all."""
        return self.setpoint if isinstance(self.setpoint, list | None) else [self.setpoint]

    def policies(self) -> list[str] | None:
        """The labels of the selected policies, or None for all."""
        return self.policy if isinstance(self.policy, list | None) else [self.policy]

    @cached_property
    def _setpoints(self) -> frozenset[float]:
        return frozenset(self.setpoints() or ())

    def selects(self, setpoint: float, label: str) -> bool:
        """Whether the split selects episodes of the cell with this setpoint and this policy label."""
        has_setpoint = self.setpoint is None or setpoint in self._setpoints
        has_label = self.policy is None or label in (self.policies() or ())
        return has_setpoint and has_label

    def indices(self, episodes: int) -> range:
        """The indices of the selected episodes in a cell of so many episodes.

        A share `first …%` has at least one episode. A share `last …%` has the rest.
        """
        if isinstance(self.episodes, EpisodeRange):
            return range(self.episodes.start, self.episodes.stop + 1)
        if isinstance(self.episodes, str) and (share := SHARE.fullmatch(self.episodes)):
            is_first, percent = share[1] == "first", int(share[2])
            border = max(1, episodes * (percent if is_first else 100 - percent) // 100)
            return range(border) if is_first else range(border, episodes)
        return range(self.episodes if isinstance(self.episodes, int) else episodes)
