"""The parts of an experiment as YAML writes them."""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated, Any, Literal, get_type_hints

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    create_model,
    model_validator,
)

from ibdata.dynamics import PAPER, SIEMENS, VARIANTS, Variant
from ibdata.policies.base import Plugin

MAX_SETPOINTS = 10_000


def _whole(value: Any) -> Any:
    """1e3 is a whole number too; true is none, which strict integers see to."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _not_reserved(name: str) -> str:
    stem = name.split(".")[0]
    if stem in {"con", "prn", "aux", "nul"} or (stem[:3] in {"com", "lpt"} and stem[3:].isdigit()):
        raise ValueError(f"found {name!r}, a reserved name on some systems, expected another")
    return name


def _not_default(name: str) -> str:
    if name == "default":
        raise ValueError("found 'default', the name of the whole dataset, expected another")
    return name


WHOLE = BeforeValidator(_whole)
Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Setpoint = Annotated[Real, Field(ge=0.0, le=100.0), AfterValidator(lambda p: p + 0.0)]  # no -0.0
FileName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$"), AfterValidator(_not_reserved)]
SplitName = Annotated[FileName, AfterValidator(_not_default)]
SetpointList = Annotated[list[Setpoint], Field(min_length=1, max_length=MAX_SETPOINTS)]


class SetpointRange(Plugin):
    """start, start + step, …, stop; the stop is included."""

    start: Setpoint
    stop: Setpoint
    step: Annotated[Real, Field(gt=0.0)]

    def values(self) -> list[float]:
        """The setpoints of the range."""
        count = math.floor((self.stop - self.start) / self.step + 1e-9) + 1
        return [self.start + i * self.step for i in range(count)]

    @model_validator(mode="after")
    def _check(self) -> SetpointRange:
        if self.stop < self.start:
            raise ValueError(f"found stop {self.stop:g} below start {self.start:g}, expected at least start")
        if (self.stop - self.start) / self.step >= MAX_SETPOINTS:
            raise ValueError(f"found more than {MAX_SETPOINTS} setpoints, expected fewer")
        return self


def _list_or(other: str) -> Discriminator:
    """Tells a list from the other form of the same field."""
    return Discriminator(lambda value: "list" if isinstance(value, list) else other)


SetpointOrList = Annotated[
    Annotated[Setpoint, Tag("number")] | Annotated[SetpointList, Tag("list")], _list_or("number")
]


class Drifting(Plugin):
    """Moving setpoints, by where they start."""

    drifting: SetpointOrList

    def values(self) -> list[float]:
        """The setpoints at the start."""
        return self.drifting if isinstance(self.drifting, list) else [self.drifting]


def _setpoints_form(value: Any) -> str:
    if isinstance(value, dict):
        return "drifting" if "drifting" in value else "range"
    if isinstance(value, Plugin):
        return "drifting" if isinstance(value, Drifting) else "range"
    return "list" if isinstance(value, list) else "word" if isinstance(value, str) else "number"


Setpoints = Annotated[
    Annotated[Setpoint, Tag("number")]
    | Annotated[Literal["drifting"], Tag("word")]
    | Annotated[SetpointList, Tag("list")]
    | Annotated[Drifting, Tag("drifting")]
    | Annotated[SetpointRange, Tag("range")],
    Discriminator(_setpoints_form),
]


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


class Overrides(Plugin):
    """A published variant with single fields replaced; `CustomDynamics` adds a field of each."""

    base: Literal["siemens", "paper"]

    def variant(self) -> Variant:
        """The variant; ValueError if the fields do not fit together."""
        given = {f.name: getattr(self, f.name) for f in dataclasses.fields(Variant)}
        return dataclasses.replace(VARIANTS[self.base], **{k: v for k, v in given.items() if v is not None})

    @model_validator(mode="after")
    def _check(self) -> Overrides:
        self.variant()
        return self


CustomDynamics = create_model(
    "CustomDynamics",
    __base__=Overrides,
    __doc__="A published variant with single fields replaced.",
    **{
        name: (
            hint | None,
            Field(
                default=None, description=f"paper: {getattr(PAPER, name)}; siemens: {getattr(SIEMENS, name)}"
            ),
        )
        for name, hint in get_type_hints(Variant).items()
    },
)  # type: ignore[call-overload]  # the fields are those of Variant, known at run time only

Dynamics = Annotated[
    Annotated[Literal["siemens", "paper"], Tag("word")] | Annotated[CustomDynamics, Tag("mapping")],
    Discriminator(lambda value: "mapping" if isinstance(value, dict | Plugin) else "word"),
]


class BurnIn(Plugin):
    """A random number of unrecorded steps with uniform random actions before the first recorded one."""

    burn_in: Annotated[
        list[Annotated[int, Field(strict=True, ge=0, le=100_000), WHOLE]], Field(min_length=2, max_length=2)
    ]

    @model_validator(mode="after")
    def _check(self) -> BurnIn:
        if self.burn_in[1] < self.burn_in[0]:
            raise ValueError(f"burn_in: found {self.burn_in}, expected [fewest, most] steps")
        return self


Start = Annotated[
    Annotated[Literal["default", "uniform"], Tag("word")] | Annotated[BurnIn, Tag("mapping")],
    Discriminator(lambda value: "mapping" if isinstance(value, dict | Plugin) else "word"),
]


class Output(Plugin):
    """How the dataset is stored; never what happens in it."""

    dtype: Literal["float32", "float64"] = "float32"
    latent: Literal[False, True, "full", "next"] = Field(
        default=True, description="Markov state at t; full: also derived values; next: also of t + 1"
    )
    shard_rows: Annotated[int, Field(strict=True, ge=1, le=100_000_000), WHOLE] = Field(
        default=1_000_000, description="rows a file; whole episodes, at least one"
    )


class EpisodeRange(Plugin):
    """Episodes of each cell by their index, from 0; the stop is included."""

    start: Annotated[int, Field(strict=True, ge=0), WHOLE] = 0
    stop: Annotated[int, Field(strict=True, ge=0), WHOLE]


class Split(Plugin):
    """The episodes that fulfil all of the conditions."""

    setpoint: SetpointOrList | None = None
    policy: (
        Annotated[
            Annotated[str, Tag("name")] | Annotated[list[str], Field(min_length=1), Tag("list")],
            _list_or("name"),
        ]
        | None
    ) = None
    episodes: (
        Annotated[
            Annotated[Annotated[int, Field(strict=True, ge=1), WHOLE], Tag("number")]
            | Annotated[EpisodeRange, Tag("range")],
            Discriminator(lambda value: "range" if isinstance(value, dict | Plugin) else "number"),
        ]
        | None
    ) = Field(default=None, description="the first so many of each cell, or {start, stop}")
    overlap: bool = Field(default=False, strict=True, description="may share episodes with other splits")

    def setpoints(self) -> list[float] | None:
        """The setpoints asked for, or None for all."""
        return self.setpoint if isinstance(self.setpoint, list | None) else [self.setpoint]

    def policies(self) -> list[str] | None:
        """The labels of the policies asked for, or None for all."""
        return self.policy if isinstance(self.policy, list | None) else [self.policy]

    def indices(self, episodes: int) -> range:
        """The episodes asked for of each cell's 0 … episodes - 1."""
        if isinstance(self.episodes, EpisodeRange):
            return range(self.episodes.start, self.episodes.stop + 1)
        return range(self.episodes if self.episodes is not None else episodes)
