"""The fields of an experiment: numbers and names, setpoints, start, output and splits."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from fractions import Fraction
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from ibdata._numerics.naming import NAME_PATTERN, counted, decimal, exact
from ibdata.errors import excerpt, meant, suggestion
from ibdata.policies.base import FROM_FLOAT, FrozenModel

LICENCE = "CC-BY-4.0"  # the licence where an experiment names none
LICENCE_PATTERN = r"^[A-Za-z0-9(][A-Za-z0-9.+() -]{0,198}[A-Za-z0-9.+)]$"
MAX_SETPOINTS = 10_000
MOST_SHOWN = 10  # setpoints in a message
SHARE_PATTERN = r"^(first|last) ([1-9][0-9]?) ?%$"


def _not_default(name: str) -> str:
    if name == "default":
        raise ValueError("found 'default', the name of the whole dataset; choose another")
    return name


def of_types(*types: type) -> BeforeValidator:
    """Make a number of another type text, which a Literal refuses: to Python, 1 is true."""
    return BeforeValidator(lambda x: str(x) if isinstance(x, int | float) and type(x) not in types else x)


Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]


def _setpoint(value: float) -> float:
    """A number without the sign of -0.0; one that comes from a float32, as in tables, is its decimal."""
    single = np.float32(value)
    return (decimal(single) if float(single) == value else value) + 0.0


Setpoint = Annotated[Real, Field(ge=0.0, le=100.0), AfterValidator(_setpoint)]
EpisodeCount = Annotated[int, Field(strict=True, ge=1, lt=2**48), FROM_FLOAT]
StepCount = Annotated[int, Field(strict=True, ge=1, lt=2**31), FROM_FLOAT]
EpisodeIndex = Annotated[int, Field(strict=True, ge=0), FROM_FLOAT]
Seed = Annotated[int, Field(strict=True, ge=0, lt=2**64), FROM_FLOAT]
Licence = Annotated[str, Field(pattern=LICENCE_PATTERN)]
FileName = Annotated[str, Field(pattern=NAME_PATTERN)]
SplitName = Annotated[FileName, AfterValidator(_not_default)]
SetpointList = Annotated[list[Setpoint], Field(min_length=1, max_length=MAX_SETPOINTS)]


def by_type(*tags: str) -> Discriminator:
    """Choose the branch of a union by the type of a value. Any other type gets the first branch."""

    def tag(value: Any) -> str:
        if isinstance(value, dict | FrozenModel):
            name = "<mapping>"
        elif isinstance(value, list):
            name = "<list>"
        else:
            name = "<word>" if isinstance(value, str) else "<number>"
        return name if name in tags else tags[0]

    return Discriminator(tag)


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
    by_type("<number>", "<list>"),
]


class Drifting(FrozenModel):
    """Moving setpoints, given by their first values."""

    drifting: SetpointOrList


def _drifting(value: Any) -> Any:
    if isinstance(value, str) and value != "drifting":
        raise ValueError(
            f"found {excerpt(value)}, expected a number, a list, {{start, stop, step}} or drifting"
            f"{suggestion(value, ['drifting'])}"
        )
    return value


def points_of(setpoints: Any) -> list[float]:
    """The setpoints in order. If they move, these are their first values.

    >>> points_of("drifting"), points_of(70.0)
    ([50.0], [70.0])
    """
    if setpoints == "drifting":
        return [50.0]
    if isinstance(setpoints, SetpointRange):
        return setpoints.values()
    points = setpoints.drifting if isinstance(setpoints, Drifting) else setpoints
    return points if isinstance(points, list) else [points]


def repeated(points: list[float]) -> str | None:
    """The problem if a setpoint occurs twice; None otherwise."""
    twice = [point for point, count in Counter(points).items() if count > 1]
    return f"found {exact(twice[0])} twice, expected each setpoint once" if twice else None


Setpoints = Annotated[
    Annotated[Setpoint, Tag("<number>")]
    | Annotated[Literal["drifting"], BeforeValidator(_drifting), Tag("<word>")]
    | Annotated[SetpointList, Tag("<list>")]
    | Annotated[
        Annotated[Drifting, Tag("<drifting>")] | Annotated[SetpointRange, Tag("<range>")],
        Discriminator(lambda x: "<drifting>" if isinstance(x, Drifting) or "drifting" in x else "<range>"),
        Tag("<mapping>"),
    ],
    by_type("<number>", "<word>", "<list>", "<mapping>"),
]


def _ordered(pair: list[int]) -> list[int]:
    """Check that the first of two numbers is not the greater one."""
    if pair[1] < pair[0]:
        raise ValueError(f"found {pair}, expected [fewest, most] steps in this order")
    return pair


class BurnIn(FrozenModel):
    """A random number of steps with uniform random actions, which policies see but which are not recorded."""

    burn_in: Annotated[
        list[Annotated[int, Field(strict=True, ge=0, le=100_000), FROM_FLOAT]],
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
    by_type("<word>", "<mapping>"),
]


class Output(FrozenModel):
    """How the dataset is stored. The simulation does not depend on it."""

    dtype: Literal["float32", "float64"] = Field(
        default="float32", description="type of all float columns; actions are float32 values in both"
    )
    latent: Annotated[Literal[False, True, "full", "next"], of_types(bool)] = Field(
        default=True, description="Markov state at t; full: with derived values; next: with that at t + 1"
    )
    expert_action: bool = Field(
        default=False,
        strict=True,
        description="whether each row has the action that the expert would take there",
    )
    shard_rows: Annotated[int, Field(strict=True, ge=1, le=100_000_000), FROM_FLOAT] = Field(
        default=1_000_000, description="most rows of a file, which holds whole episodes and at least one"
    )


class EpisodeRange(FrozenModel):
    """Episodes of each cell by their index, which begins at 0; the stop is included."""

    start: EpisodeIndex = Field(default=0, description="the first")
    stop: EpisodeIndex = Field(description="the last")


Unfit = tuple[str, str]  # a key of a split, and what is wrong with its value


class Split(FrozenModel):
    """The episodes that meet all of these conditions."""

    setpoint: SetpointOrList | None = Field(default=None, description="one or a list; default: all")
    policy: (
        Annotated[
            Annotated[str, Tag("<word>")] | Annotated[list[str], Field(min_length=1), Tag("<list>")],
            by_type("<word>", "<list>"),
        ]
        | None
    ) = Field(default=None, description="a label or a list; default: all")
    episodes: (
        Annotated[
            Annotated[Annotated[int, Field(strict=True, ge=1), FROM_FLOAT], Tag("<number>")]
            | Annotated[EpisodeRange, Tag("<mapping>")]
            | Annotated[str, Field(pattern=SHARE_PATTERN), BeforeValidator(str), Tag("<word>")],
            by_type("<word>", "<number>", "<mapping>"),
        ]
        | None
    ) = Field(
        default=None,
        description="how many of each cell, {start, stop}, first 90%, or last 10%; default: all",
    )
    overlap: bool = Field(default=False, strict=True, description="may share episodes with other splits")

    @cached_property
    def setpoints(self) -> Mapping[float, None] | None:
        """The selected setpoints as keys, or None for all."""
        if self.setpoint is None:
            return None
        return dict.fromkeys(self.setpoint if isinstance(self.setpoint, list) else [self.setpoint])

    @property
    def labels(self) -> list[str] | None:
        """The labels of the selected policies, or None for all."""
        return self.policy if isinstance(self.policy, list | None) else [self.policy]

    def selects(self, setpoint: float, label: str) -> bool:
        """Whether the split selects episodes of the cell with this setpoint and this policy label."""
        has_setpoint = self.setpoints is None or setpoint in self.setpoints
        return has_setpoint and (self.labels is None or label in self.labels)

    def unfit(self, setpoints: Collection[float], labels: Collection[str], episodes: int) -> Iterator[Unfit]:
        """The problems, by key, of a split of cells with these setpoints and labels and so many episodes."""
        known = ", ".join(map(exact, sorted(setpoints)[:MOST_SHOWN]))
        more = ", …" if len(setpoints) > MOST_SHOWN else ""
        for setpoint in self.setpoints or ():
            if setpoint not in setpoints:
                yield "setpoint", f"found {exact(setpoint)}, expected one of the setpoints {known}{more}"
        for label in self.labels or ():
            if label not in labels:
                yield "policy", f"found {label!r}{meant(label, labels)}"
        indices = self.indices(episodes)
        if isinstance(self.episodes, str) and not indices:
            problem = f"which is none of {counted(episodes, 'episode')}, expected at least one"
            yield "episodes", f"found {self.episodes}, {problem}"
        elif not indices or indices.stop > episodes:
            found = f"found episodes {indices.start} to {indices.stop - 1}"
            yield "episodes", f"{found}, expected some of 0 to {episodes - 1}"

    def indices(self, episodes: int) -> range:
        """The indices of the selected episodes in a cell of so many episodes.

        A share `first …%` has at least one episode. A share `last …%` has the rest.
        """
        if isinstance(self.episodes, EpisodeRange):
            return range(self.episodes.start, self.episodes.stop + 1)
        if isinstance(self.episodes, str) and (share := re.match(SHARE_PATTERN, self.episodes)):
            is_first, percent = share[1] == "first", int(share[2])
            border = max(1, episodes * (percent if is_first else 100 - percent) // 100)
            return range(border) if is_first else range(border, episodes)
        return range(self.episodes if isinstance(self.episodes, int) else episodes)
