"""The model of an experiment, which determines the contents of a dataset."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from itertools import combinations, pairwise, product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PrivateAttr, ValidationInfo, model_validator

from ibdata._numerics.naming import unequal
from ibdata._numerics.ranges import joined
from ibdata.errors import Loc, Problems
from ibdata.experiment.fields import (
    LICENCE,
    EpisodeCount,
    FileName,
    Licence,
    Output,
    Seed,
    Setpoints,
    Split,
    SplitName,
    Start,
    StepCount,
    of_types,
    repeated,
)
from ibdata.experiment.messages import refusals
from ibdata.experiment.scenario import Cell, Dynamics, Scenario
from ibdata.policies import AnyPolicy
from ibdata.policies.base import FrozenModel
from ibdata.policies.compound import block_of
from ibdata.policies.user_object import ObjectPolicy

if TYPE_CHECKING:
    from typing_extensions import Self

MAX_SHARDS = 10_000_000
SPLITS_REMEDY = "; change it, or leave out all splits by the override splits={}"


def _labelled(policy: Any) -> Any:
    """A policy; one that is the name of a network has it as its label, too."""
    block = block_of(policy)
    return {**block, "name": policy} if isinstance(policy, str) and "file" in block else block


class Experiment(FrozenModel):
    """The description of a dataset, from which `generate` makes it.

    Each combination of a policy and a setpoint is a cell, which has `episodes` episodes of `steps` steps.
    `ibdata.load` reads an experiment from a YAML file. The constructor takes the same options, and raises
    ConfigError if they are not valid.
    """

    if not TYPE_CHECKING:  # type checkers and editors show the options below

        def __init__(self, **options: Any) -> None:
            with refusals(options, Experiment) as options:
                super().__init__(**options)

        # Because of this attribute of pydantic, `model_validate` does not call __init__.
        __init__.__pydantic_base_init__ = True

    version: Annotated[Literal[1], of_types(int, float)] = Field(
        default=1, description="version of this format"
    )
    name: FileName = Field(description="name of the experiment, its dataset and its folder")
    dynamics: Dynamics = Field(default="siemens", description="siemens, paper, or {base: …, field: value}")
    setpoints: Setpoints = Field(
        description="a number, a list, {start, stop, step}, drifting, or {drifting: …}; in [0, 100]"
    )
    policies: Annotated[
        list[Annotated[AnyPolicy, BeforeValidator(_labelled)]], Field(min_length=1, max_length=1000)
    ] = Field(description="names of policies, or blocks with a kind and its options")
    episodes: EpisodeCount = Field(default=1, description="number of episodes per setpoint and policy")
    steps: StepCount = Field(default=1000, description="number of steps, and rows, per episode")
    start: Start = Field(
        default="default",
        description="default: v = g = h = 50; uniform: v, g and h uniform in [0, 100]; "
        "{burn_in: [fewest, most]}: after so many random steps",
    )
    seed: Seed = Field(default=0, description="seed of all random numbers")
    output: Output = Field(default=Output(), description="how the dataset is stored")
    splits: dict[SplitName, Split] = Field(
        default={}, description="named sets of episodes", json_schema_extra={"additionalProperties": False}
    )
    licence: Licence = Field(
        default=LICENCE, description="licence of the dataset, an SPDX expression; its card names it"
    )

    _folder: Path | None = PrivateAttr(None)  # of the YAML file, if it was loaded from one

    @cached_property
    def scenario(self) -> Scenario:
        """What is simulated."""
        return Scenario.model_construct(
            dynamics=self.dynamics,
            setpoint=self.setpoints,
            start=self.start,
            steps=self.steps,
            episodes=self.episodes,
            seed=self.seed,
        )

    @property
    def checked_with(self) -> dict[str, Any]:
        """The folder, and the weights of all networks by their SHA-256, so that a copy needs no file."""
        of_policies = super().checked_with  # with the folder of one that is from a file
        return {**of_policies, "folder": self._folder} if self._folder else of_policies

    @property
    def drifting(self) -> bool:
        """Whether the setpoints move."""
        return self.scenario.drifting

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """The labels of the policies in the data. Repeated labels get the endings -2, -3, …"""
        return tuple(unequal(policy.label for policy in self.policies))

    @cached_property
    def cells(self) -> tuple[Cell, ...]:
        """All cells in the order of the dataset, by policy and then by setpoint."""
        return self.scenario.cells(zip(self.labels, self.policies, strict=True))

    @property
    def episode_count(self) -> int:
        """The number of episodes of all cells."""
        return len(self.cells) * self.episodes

    @property
    def episodes_per_policy(self) -> int:
        """The number of episodes of each policy, which follow one another."""
        return self.episode_count // len(self.policies)

    @property
    def rows(self) -> int:
        """The number of transitions in the dataset."""
        return self.episode_count * self.steps

    def cell_of(self, episode: int) -> Cell:
        """The cell of an episode, by its number in the experiment."""
        return self.cells[episode // self.episodes]

    def segments(self, splits: Mapping[str, Split]) -> list[tuple[int, int, tuple[str, ...]]]:
        """The longest ranges (first, stop, names) of episodes that are in the same ones of these splits."""
        n = self.episodes
        indices = {name: split.indices(n) for name, split in splits.items()}
        ends = (end for selected in indices.values() for end in (selected.start, selected.stop))
        borders = sorted({0, n, *(min(n, end) for end in ends)})
        ranges: list[tuple[int, int, tuple[str, ...]]] = []
        for i, cell in enumerate(self.cells):
            of_cell = [name for name, split in splits.items() if split.selects(cell.setpoint, cell.label)]
            for low, high in pairwise(borders):
                names = tuple(name for name in of_cell if low in indices[name])
                ranges.append((i * n + low, i * n + high, names))
        return joined(ranges)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Copy as pydantic does, but keep the folder. Raises ConfigError if the copy is not valid."""
        with refusals({**self.options(), **(update or {})}, type(self)) as options:
            return super().model_copy(update={name: options[name] for name in update or {}}, deep=deep)

    def part(self, steps: int, episodes: int) -> Experiment:
        """The same cells with fewer steps and episodes, and without splits, which may name other episodes."""
        return self.with_options(steps=steps, episodes=episodes, splits={})

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> Experiment:
        folder = (info.context or {}).get("folder")
        self._folder = folder and folder.absolute()
        problems: list[tuple[Loc, str]] = []
        setpoints = self.scenario.points
        cells = len(setpoints) * len(self.policies)
        if cells * self.episodes / max(1, self.output.shard_rows // self.steps) > MAX_SHARDS:
            message = f"found more than {MAX_SHARDS} files, expected at most {MAX_SHARDS}"
            problems.append((("output", "shard_rows"), message))
        if problem := repeated(setpoints):
            problems.append((("setpoints",), problem))
        forms = [policy.form() for policy in self.policies]
        for i, form in enumerate(forms):
            if form in forms[:i] and not any(self.policies[i].everywhere(ObjectPolicy)):
                message = f"found the same policy as policies.{forms.index(form)}; remove one of the two"
                problems.append((("policies", i), message))
        for name, split in self.splits.items():
            for key, problem in split.unfit(set(setpoints), self.labels, self.episodes):
                remedy = SPLITS_REMEDY if key == "episodes" else ""
                problems.append((("splits", name, key), f"{problem}{remedy}"))
        if problems := problems or list(self.shared(self.splits)):
            raise Problems(problems)
        return self

    def shared(self, splits: Mapping[str, Split]) -> Iterator[tuple[Loc, str]]:
        """The pairs of splits that share episodes without `overlap: true`, as problems of the second one."""
        disjoint = {name: split for name, split in splits.items() if not split.overlap}
        if len(disjoint) < 2:
            return
        pairs = {pair for _, _, names in self.segments(disjoint) for pair in combinations(names, 2)}
        for second, first in product(disjoint, disjoint):
            if (first, second) in pairs:
                message = f"shares episodes with {first}; change one of the two, or set overlap: true"
                yield ("splits", second), message
