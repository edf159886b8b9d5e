"""The specification of a dataset: its experiments, several in a merged dataset, and its later splits."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

from pydantic import ValidationError, ValidationInfo, model_validator

from ibdata._numerics.ranges import joined
from ibdata.dataset import manifest
from ibdata.dataset.stored import Stored
from ibdata.errors import DatasetError, Loc, Problems, printable
from ibdata.experiment.fields import EpisodeRange, Split, SplitName
from ibdata.experiment.messages import ConfigProblem, refusals
from ibdata.experiment.models import Experiment
from ibdata.policies.base import FrozenModel
from ibdata.policies.code import Acting
from ibdata.policies.network import Network
from ibdata.policies.user_object import Custom, ObjectPolicy, UserObject
from ibdata.policies.weights_file import Weights


class Shard(NamedTuple):
    """Episodes first … stop - 1 of an experiment, all in the same splits.

    A merged dataset has several experiments. `experiment` is the index of this one, and `offset` is the
    number of episodes in the experiments before it.
    """

    number: int
    first: int
    stop: int
    splits: tuple[str, ...]
    experiment: int
    offset: int

    @property
    def stem(self) -> str:
        """The beginning of the shard's path inside the dataset; a token follows."""
        return f"data/part-{self.number:05d}"


class NamedSplits(FrozenModel):
    """Splits of a finished dataset, by name."""

    splits: dict[SplitName, Split]

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> NamedSplits:
        """Check that each has episodes of the dataset in the context, whose experiments may differ."""
        spec: DatasetSpec = (info.context or {})["spec"]
        problems: list[tuple[Loc, str]] = []
        for name, split in self.splits.items():
            sizes = spec.sizes(split)
            # So many episodes are in each cell; a range may be in some.
            size = (min if isinstance(split.episodes, int) else max)(sizes or [sys.maxsize])
            found = list(split.unfit(spec.setpoints, spec.labels, size))
            if not (sizes or found):
                found.append(("policy", "found no episodes of this policy at this setpoint, expected some"))
            problems += [(("splits", name, key), problem) for key, problem in found]
        if not problems:
            problems = [problem for each in spec.experiments for problem in each.shared(self.splits)]
        if problems:
            raise Problems(problems)
        return self


def fitting(split: Split, experiment: Experiment) -> Split | None:
    """The part of a split that an experiment has; None if it has none."""
    cells = [cell for cell in experiment.cells if split.selects(cell.setpoint, cell.label)]
    indices = split.indices(experiment.episodes)
    stop = min(indices.stop, experiment.episodes)
    if not cells or indices.start >= stop:
        return None
    return Split(
        setpoint=None if split.setpoint is None else list(dict.fromkeys(cell.setpoint for cell in cells)),
        policy=None if split.policy is None else list(dict.fromkeys(cell.label for cell in cells)),
        episodes=EpisodeRange(start=indices.start, stop=stop - 1),
        overlap=True,
    )


@dataclass(frozen=True)
class DatasetSpec:
    """The experiments of a dataset in order. The splits in `later` label episodes and have no files."""

    name: str
    experiments: tuple[Experiment, ...]
    later: Mapping[str, Split] = field(default_factory=dict)

    @classmethod
    def of(cls, experiment: Experiment) -> DatasetSpec:
        """The specification of a dataset with one experiment."""
        return cls(experiment.name, (experiment,))

    @classmethod
    def from_plain(cls, data: Mapping[str, Any], weights: Mapping[str, bytes]) -> DatasetSpec:
        """Read the data of `plain` and `weights`, or of a dataset."""
        known = {}
        for path, content in weights.items():
            try:
                read = Weights(content)
            except ValueError as error:
                raise DatasetError(f"{path}: {error}") from None
            known[read.sha256] = read
        context = {"weights": known}
        experiments = (Experiment.model_validate(plain, context=context) for plain in data["experiments"])
        return cls(data["name"], tuple(experiments))

    def __reduce__(self) -> tuple[type[DatasetSpec], tuple[Any, ...]]:
        return DatasetSpec, (self.name, self.experiments, self.later)  # without what was computed

    def plain(self) -> dict[str, Any]:
        """Name and experiments as plain data for JSON. No shard needs the later splits."""
        return {"name": self.name, "experiments": [experiment.plain() for experiment in self.experiments]}

    def difference(self, name: str, recorded: Sequence[Any]) -> str | None:
        """The first option that differs in a name and plain experiments; None if these mean the same."""
        if len(recorded) != len(self.experiments):
            return f"experiments: found {len(recorded)}, expected {len(self.experiments)}"
        differences = filter(None, map(Experiment.difference, self.experiments, recorded))
        other_name = None if name == self.name else f"name: found {name!r}, expected {self.name!r}"
        return next(differences, other_name)

    @cached_property
    def shards(self) -> list[Shard]:
        """The shards in order: whole episodes, at least one, and at most `output.shard_rows` rows in each.

        A new one begins where a declared split begins or ends, so that every split consists of whole files.
        """
        shards: list[Shard] = []
        offset = 0
        for i, experiment in enumerate(self.experiments):
            most = max(1, experiment.output.shard_rows // experiment.steps)
            for first, stop, splits in experiment.segments(experiment.splits):
                for start in range(first, stop, most):
                    shards.append(Shard(len(shards), start, min(start + most, stop), splits, i, offset))
            offset += experiment.episode_count
        return shards

    @property
    def declared(self) -> list[str]:
        """The names of the splits that consist of whole files, in order."""
        return list(dict.fromkeys(name for experiment in self.experiments for name in experiment.splits))

    @property
    def rows(self) -> int:
        """The number of transitions in the dataset."""
        return sum(experiment.rows for experiment in self.experiments)

    @property
    def episodes(self) -> int:
        """The number of episodes in the dataset."""
        return sum(experiment.episode_count for experiment in self.experiments)

    @property
    def labels(self) -> list[str]:
        """The policies' labels, in order."""
        return list(dict.fromkeys(label for experiment in self.experiments for label in experiment.labels))

    @property
    def setpoints(self) -> list[float]:
        """The setpoints, in ascending order."""
        return sorted({cell.setpoint for experiment in self.experiments for cell in experiment.cells})

    @property
    def licences(self) -> list[str]:
        """The licences of the experiments, in order."""
        return list(dict.fromkeys(experiment.licence for experiment in self.experiments))

    @property
    def weights(self) -> dict[str, bytes]:
        """The contents of the weights files of all networks, by their names in a dataset."""
        networks = (network for each in self.experiments for network in each.everywhere(Network))
        return {network.weights.name: network.weights.data for network in networks}

    @cached_property
    def user_objects(self) -> list[UserObject]:
        """The policies that act through objects of users, including parts of others."""
        return [policy for experiment in self.experiments for policy in experiment.everywhere(UserObject)]

    @cached_property
    def live(self) -> list[ObjectPolicy]:
        """Those whose object is one of a Python session."""
        return [policy for policy in self.user_objects if isinstance(policy, ObjectPolicy)]

    @cached_property
    def custom(self) -> list[Custom]:
        """Those whose object is made by code that is named."""
        return [policy for policy in self.user_objects if isinstance(policy, Custom)]

    def loaded(self, acting: Acting) -> DatasetSpec:
        """A copy in which all objects of users are loaded, so that they can act until `acting` ends."""
        return replace(self, experiments=tuple(each.loaded(acting) for each in self.experiments))

    def rows_in(self, shards: Iterable[Shard]) -> int:
        """The number of transitions in some of the shards."""
        return sum((shard.stop - shard.first) * self.experiments[shard.experiment].steps for shard in shards)

    def sizes(self, split: Split) -> list[int]:
        """The episodes of a cell in each experiment that has cells of a split."""
        return [
            experiment.episodes
            for experiment in self.experiments
            if any(split.selects(cell.setpoint, cell.label) for cell in experiment.cells)
        ]

    def checked(self, splits: Mapping[str, Any]) -> dict[str, Split]:
        """Splits of this dataset, from plain data or as they are.

        Raises ConfigError for one that is not valid, names what no experiment has, or shares episodes.
        """

        def line(problem: ConfigProblem) -> str:
            return f"split {problem._replace(loc=problem.loc[1:]).text}"

        with refusals({"splits": splits}, NamedSplits, line) as given:
            return NamedSplits.model_validate(given, context={"spec": self}).splits

    def later_runs(self) -> dict[str, list[tuple[int, int, int]]]:
        """The episodes of each later split, as runs (first, stop, steps): those of a run are equally long."""
        runs: dict[str, list[tuple[int, int, int]]] = {name: [] for name in self.later}
        offset = 0
        for experiment in self.experiments:
            for first, stop, names in experiment.segments(self.later):
                for name in names:
                    runs[name].append((offset + first, offset + stop, experiment.steps))
            offset += experiment.episode_count
        return {name: joined(of_split) for name, of_split in runs.items()}

    def all_declared(self) -> DatasetSpec:
        """A copy that declares the later splits, so that their episodes get files of their own."""
        experiments = []
        for experiment in self.experiments:
            fitted = {name: fitting(split, experiment) for name, split in self.later.items()}
            later = {name: split for name, split in fitted.items() if split is not None}
            experiments.append(experiment.model_copy(update={"splits": {**experiment.splits, **later}}))
        return DatasetSpec(self.name, tuple(experiments))


def declared_spec(stored: Stored) -> DatasetSpec:
    """Read the specification in the manifest of a dataset, and the weights files of the dataset.

    Raises DatasetError if it is not valid or weights are missing.
    """
    paths = [path for path in stored.manifest.entries() if manifest.WEIGHTS.fullmatch(path)]
    weights = {path: stored.read(path) for path in paths}
    try:
        plain = stored.manifest.model_dump(include={"name", "experiments"})
        return DatasetSpec.from_plain(plain, weights)
    except ValidationError as error:
        raise stored.storage.error(manifest.PATH, f"experiments: {_first_line(error)}") from None


def spec_in(stored: Stored) -> DatasetSpec:
    """Read the specification as `declared_spec` does, and the later splits.

    Raises DatasetError also if those splits are not valid.
    """
    spec, entries = declared_spec(stored), stored.splits
    try:
        later = {
            name: Split.model_validate(entry.split) for name, entry in entries.items() if not entry.declared
        }
    except ValidationError as error:
        raise stored.error(manifest.SPLITS, _first_line(error)) from None
    return replace(spec, later=later)


def _first_line(error: ValidationError) -> str:
    """The path and the message of the first problem."""
    problem = error.errors(include_url=False)[0]
    path = ".".join(map(str, problem["loc"]))
    return printable(f"{path}: {problem['msg']}")
