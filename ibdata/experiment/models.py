"""The model of an experiment, which determines the contents of a dataset."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError, ValidationInfo, field_validator, model_validator

from ibdata.dynamics import VARIANTS, Variant
from ibdata.errors import ConfigError, Loc, Problems, suggestion
from ibdata.experiment.cells import Cell, variant_form
from ibdata.experiment.dynamics import Dynamics
from ibdata.experiment.fields import Output, Split, Start
from ibdata.experiment.messages import problems, shown
from ibdata.experiment.plain import plain
from ibdata.experiment.scalars import LICENCE, WHOLE, FileName, Licence, SplitName
from ibdata.experiment.setpoints import Setpoints, setpoint_values
from ibdata.numerics.naming import exact
from ibdata.policies import AnyPolicy
from ibdata.policies.base import FrozenModel

if TYPE_CHECKING:
    from typing_extensions import Self

MAX_CELLS = 1_000_000
MAX_SHARDS = 10_000_000


def _no_bool(value: Any) -> Any:
    if isinstance(value, bool):
        raise ValueError(f"found {shown(value)}, expected 1")
    return value


@contextmanager
def refusals(data: Mapping[str, Any]) -> Iterator[None]:
    """Raise ConfigError with a line `key: found, expected` for each problem that pydantic finds."""
    try:
        yield
    except ValidationError as error:
        found = problems(error, Experiment, data)
        raise ConfigError([f"{problem.key}: {problem.message}" for problem in found]) from None


class Experiment(FrozenModel):
    """The description of a dataset, from which `generate` makes it.

    Each combination of a policy and a setpoint is a cell, which has `episodes` episodes of `steps` steps.
    `ibdata.load` reads an experiment from a YAML file. The constructor takes the same options, and raises
    ConfigError if they are not valid.
    """

    if not TYPE_CHECKING:  # type checkers and editors show the options below

        def __init__(self, **options: Any) -> None:
            options = plain(options)
            with refusals(options):
                super().__init__(**options)

        # With this mark of pydantic's own, `model_validate` does not call __init__.
        __init__.__pydantic_base_init__ = True

    version: Annotated[Literal[1], BeforeValidator(_no_bool)] = Field(
        default=1, description="version of this format"
    )
    name: FileName = Field(description="name of the experiment, its dataset and its folder")
    dynamics: Dynamics = Field(default="siemens", description="siemens, paper, or {base: …, field: value}")
    setpoints: Setpoints = Field(
        description="a number, a list, {start, stop, step}, drifting, or {drifting: …}; in [0, 100]"
    )
    policies: Annotated[list[AnyPolicy], Field(min_length=1, max_length=1000)] = Field(
        description="names of policies, or blocks with a kind and its options"
    )
    episodes: Annotated[int, Field(strict=True, ge=1, lt=2**48), WHOLE] = Field(
        default=1, description="number of episodes per setpoint and policy"
    )
    steps: Annotated[int, Field(strict=True, ge=1, lt=2**31), WHOLE] = Field(
        default=1000, description="number of steps, and rows, per episode"
    )
    start: Start = Field(
        default="default",
        description="default: v = g = h = 50; uniform: anywhere; {burn_in: [fewest, most]} random steps",
    )
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**64), WHOLE] = Field(
        default=0, description="seed of all random numbers"
    )
    output: Output = Field(default=Output(), description="how the dataset is stored")
    splits: dict[SplitName, Split] = Field(
        default={}, description="named sets of episodes", json_schema_extra={"additionalProperties": False}
    )
    licence: Licence = Field(
        default=LICENCE, description="licence of the dataset, an SPDX expression; its card names it"
    )

    @cached_property
    def folder(self) -> Path | None:
        """The folder of the YAML file, if it was loaded from one; not part of the experiment."""
        return None

    @cached_property
    def variant(self) -> Variant:
        """The dynamics as a variant."""
        return VARIANTS[self.dynamics] if isinstance(self.dynamics, str) else self.dynamics.variant()

    @cached_property
    def drifting(self) -> bool:
        """Whether the setpoints move."""
        return setpoint_values(self.setpoints)[1]

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """The labels of the policies in the data. If several have the same, the later ones get -2, -3, …"""
        labels: dict[str, None] = {}
        for policy in self.policies:
            label, count = policy.label, 1
            while label in labels:
                count += 1
                label = f"{policy.label}-{count}"
            labels[label] = None
        return tuple(labels)

    @cached_property
    def cells(self) -> tuple[Cell, ...]:
        """All cells in the order of the dataset, by policy and then by setpoint."""
        setpoints, drifting = setpoint_values(self.setpoints)
        dynamics = variant_form(
            self.dynamics if isinstance(self.dynamics, str) else self.dynamics.base, self.variant
        )
        start = self.start if isinstance(self.start, str) else self.start.model_dump()
        return tuple(
            Cell(dynamics, setpoint, drifting, policy, label, start)
            for policy, label in zip(self.policies, self.labels, strict=True)
            for setpoint in setpoints
        )

    @property
    def rows(self) -> int:
        """The number of transitions in the dataset."""
        return len(self.cells) * self.episodes * self.steps

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Copy as pydantic does, but keep the folder, and raise ConfigError for an invalid copy."""
        changes = plain(update or {})
        with refusals({**self.options(), **changes}):
            copy = super().model_copy(update=changes, deep=deep)
        vars(copy)["folder"] = self.folder
        return copy

    def part(self, steps: int, episodes: int) -> Experiment:
        """The same cells with fewer steps and episodes, and without what is said of other episodes."""
        return self.model_copy(update={"steps": steps, "episodes": episodes, "splits": {}})

    def in_full(self) -> dict[str, Any]:
        """The experiment as plain data for YAML, including all defaults."""
        return self.model_dump(mode="json", exclude_none=True)

    def plain(self) -> dict[str, Any]:
        """The experiment as a dataset records it: in full, but without the licence if it is the default one.

        So the experiments that were recorded before there were licences keep their bytes.
        """
        plain = self.in_full()
        if self.licence == LICENCE:
            del plain["licence"]
        return plain

    @field_validator("splits")
    @classmethod
    def _in_numbers(cls, splits: dict[str, Split], known: ValidationInfo) -> dict[str, Split]:
        """Give the shares of splits the numbers of their episodes, and leave out those without any."""
        episodes = known.data.get("episodes")
        found = {name: split.in_numbers(episodes) for name, split in splits.items()} if episodes else splits
        return {name: split for name, split in found.items() if split is not None}

    @model_validator(mode="after")
    def _check(self) -> Experiment:
        cells = len(setpoint_values(self.setpoints)[0]) * len(self.policies)
        if cells > MAX_CELLS:
            raise Problems(
                [(("setpoints",), f"found more than {MAX_CELLS} cells, expected at most {MAX_CELLS}")]
            )
        per_shard = max(1, self.output.shard_rows // self.steps)
        if cells * self.episodes / per_shard > MAX_SHARDS:
            raise Problems(
                [
                    (
                        ("output", "shard_rows"),
                        f"found more than {MAX_SHARDS} files, expected at most {MAX_SHARDS}",
                    )
                ]
            )
        found = [*self._equal_cells(), *self._unknown_in_splits()] or list(self._shared_episodes())
        if found:
            raise Problems(found)
        return self

    def _equal_cells(self) -> Iterator[tuple[Loc, str]]:
        setpoints, _ = setpoint_values(self.setpoints)
        if len(set(setpoints)) < len(setpoints):
            twice = next(p for i, p in enumerate(setpoints) if p in setpoints[:i])
            yield ("setpoints",), f"found {exact(twice)} twice, expected each setpoint once"
        forms = [policy.form() for policy in self.policies]
        for i, form in enumerate(forms):
            if form in forms[:i]:
                yield (
                    ("policies", i),
                    f"found the same policy as policies.{forms.index(form)}; remove one of the two",
                )

    def _unknown_in_splits(self) -> Iterator[tuple[Loc, str]]:
        for name, split in self.splits.items():
            for p in split.setpoints() or []:
                if p not in self._known_setpoints:
                    yield (
                        ("splits", name, "setpoint"),
                        f"found {exact(p)}, expected one of the setpoints of the experiment",
                    )
            for label in split.policies() or []:
                if label not in self.labels:
                    yield (
                        ("splits", name, "policy"),
                        f"found {label!r}, expected one of {', '.join(self.labels)}"
                        f"{suggestion(label, self.labels)}",
                    )
            indices = split.indices(self.episodes)
            if not indices or indices.stop > self.episodes:
                yield (
                    ("splits", name, "episodes"),
                    f"found episodes {indices.start} to {indices.stop - 1}, expected some of 0 to "
                    f"{self.episodes - 1}; change it, or leave out all splits by the override splits={{}}",
                )

    def _shared_episodes(self) -> Iterator[tuple[Loc, str]]:
        """Splits that share episodes. A split is a product of axes, so two do if they meet on each axis."""
        names = [name for name, split in self.splits.items() if not split.overlap]
        axes = {name: self._axes(self.splits[name]) for name in names}
        for i, b in enumerate(names):
            for a in names[:i]:
                (p, policies, indices), (q, others, more) = axes[a], axes[b]
                if _meet(indices, more) and not policies.isdisjoint(others) and not p.isdisjoint(q):
                    yield (
                        ("splits", b),
                        f"shares episodes with {a}; change one of the two, or set overlap: true",
                    )

    def _axes(self, split: Split) -> tuple[frozenset[float], frozenset[str], range]:
        setpoints, policies = split.setpoints(), split.policies()
        return (
            self._known_setpoints if setpoints is None else frozenset(setpoints),
            frozenset(self.labels if policies is None else policies),
            split.indices(self.episodes),
        )

    @cached_property
    def _known_setpoints(self) -> frozenset[float]:
        return frozenset(setpoint_values(self.setpoints)[0])


def _meet(a: range, b: range) -> bool:
    return max(a.start, b.start) < min(a.stop, b.stop)
