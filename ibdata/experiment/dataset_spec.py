"""The specification of a dataset: its experiment, or several if it was merged, and splits made later."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, field
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.errors import DatasetError, printable
from ibdata.experiment.fields import EpisodeRange, Split
from ibdata.experiment.models import Experiment
from ibdata.experiment.plan import Shard, episodes_per_shard, plan, segments
from ibdata.policies import Policy
from ibdata.policies.network import Network
from ibdata.policies.weights_file import kept


def fitting(split: Split, experiment: Experiment, known: Set[float]) -> Split | None:
    """A split without the setpoints, policies and episodes that an experiment lacks; None if nothing is left.

    Args:
        split: the split.
        experiment: the experiment.
        known: the setpoints of the experiment.
    """
    setpoints, labels = split.setpoints(), split.policies()
    indices = split.indices(experiment.episodes)
    stop = min(indices.stop, experiment.episodes)
    own = None if setpoints is None else [p for p in setpoints if p in known]
    policies = None if labels is None else [label for label in labels if label in experiment.labels]
    if own == [] or policies == [] or indices.start >= stop:
        return None
    episodes = EpisodeRange(start=indices.start, stop=stop - 1)
    return Split(setpoint=own, policy=policies, episodes=episodes, overlap=True)


@dataclass(frozen=True)
class DatasetSpec:
    """The experiments of a dataset in order; `later` are splits that label episodes and have no files."""

    name: str
    experiments: tuple[Experiment, ...]
    later: Mapping[str, Split] = field(default_factory=dict)

    @classmethod
    def of(cls, experiment: Experiment) -> DatasetSpec:
        """The specification of a dataset that `generate` makes."""
        return cls(experiment.name, (experiment,))

    @classmethod
    def from_plain(cls, data: Mapping[str, Any], weights: Mapping[str, bytes]) -> DatasetSpec:
        """Read what `plain` and `weights` returned, or what a dataset holds."""
        for path, content in weights.items():
            try:
                kept(content)
            except ValueError as error:
                raise DatasetError(f"{path}: {error}") from None
        return cls(
            data["name"],
            tuple(Experiment.model_validate(experiment) for experiment in data["experiments"]),
            {name: Split.model_validate(split) for name, split in data["splits"].items()},
        )

    def plain(self) -> dict[str, Any]:
        """Name, experiments and later splits as plain data for JSON."""
        return {
            "name": self.name,
            "experiments": [experiment.plain() for experiment in self.experiments],
            "splits": {
                name: split.model_dump(mode="json", exclude_none=True) for name, split in self.later.items()
            },
        }

    @cached_property
    def shards(self) -> list[Shard]:
        """The shards of all experiments, in order."""
        shards: list[Shard] = []
        offset = 0
        for i, experiment in enumerate(self.experiments):
            first = len(shards)
            shards += [
                shard._replace(number=first + shard.number, experiment=i, offset=offset)
                for shard in plan(experiment)
            ]
            offset += len(experiment.cells) * experiment.episodes
        return shards

    @property
    def declared(self) -> list[str]:
        """The names of the splits that consist of whole files, in order."""
        return list(dict.fromkeys(name for e in self.experiments for name in e.splits))

    @property
    def rows(self) -> int:
        """The number of transitions in the dataset."""
        return sum(experiment.rows for experiment in self.experiments)

    @property
    def episodes(self) -> int:
        """The number of episodes in the dataset."""
        return sum(len(e.cells) * e.episodes for e in self.experiments)

    @property
    def least_shards(self) -> int:
        """The least number of shards, which is known without a list of them."""
        return sum(-(-len(e.cells) * e.episodes // episodes_per_shard(e)) for e in self.experiments)

    @property
    def labels(self) -> list[str]:
        """The policies' labels, in order."""
        return list(dict.fromkeys(label for e in self.experiments for label in e.labels))

    @property
    def licences(self) -> list[str]:
        """The licences of the experiments, in order."""
        return list(dict.fromkeys(e.licence for e in self.experiments))

    @property
    def code_targets(self) -> list[str]:
        """The `package.module:name` of every custom policy, including those of which another is made."""
        found = (policy.code_target for policy in self._policies())
        return list(dict.fromkeys(target for target in found if target is not None))

    @property
    def weights(self) -> dict[str, bytes]:
        """The files of the weights of all networks, by the names that they have in a dataset."""
        return {p.file: p.weights.data for p in self._policies() if isinstance(p, Network)}

    def _policies(self) -> Iterator[Policy]:
        """All policies, and those of which they are made."""
        return (each for e in self.experiments for policy in e.policies for each in policy.everywhere())

    def of_shard(self, shard: Shard) -> Experiment:
        """The experiment that a shard belongs to."""
        return self.experiments[shard.experiment]

    def runs(self, shard: Shard) -> Iterator[tuple[int, int, tuple[str, ...]]]:
        """Runs (first, stop, splits) of a shard's episodes that are in the same splits.

        Episodes are numbered as in the shard's experiment.
        """
        if not self.later:
            yield shard.first, shard.stop, shard.splits
            return
        runs = self._later_segments[shard.experiment]
        low = bisect_right(runs, shard.first, key=itemgetter(1))
        high = bisect_left(runs, shard.stop, key=itemgetter(0))
        for first, stop, names in runs[low:high]:
            yield max(first, shard.first), min(stop, shard.stop), (*shard.splits, *names)

    def all_declared(self) -> DatasetSpec:
        """A copy in which the later splits are declared, so that their episodes get files of their own."""
        experiments = []
        for experiment in self.experiments:
            known = {cell.setpoint for cell in experiment.cells}
            own = {name: fitting(split, experiment, known) for name, split in self.later.items()}
            later = {name: split for name, split in own.items() if split is not None}
            plain = {**experiment.plain(), "splits": {**experiment.splits, **later}}
            experiments.append(Experiment.model_validate(plain))
        return DatasetSpec(self.name, tuple(experiments))

    @cached_property
    def _later_segments(self) -> list[list[tuple[int, int, tuple[str, ...]]]]:
        return [segments(experiment, self.later) for experiment in self.experiments]


def spec_in(folder: Path, listed: Manifest) -> DatasetSpec:
    """Read the specification in a dataset's manifest, and the weights that the dataset carries.

    Raises DatasetError if it is not valid or weights are missing.
    """
    files = [path for path in listed.entries() if manifest.WEIGHTS.fullmatch(path)]
    weights = {path: manifest.listed_content(folder, listed, path) for path in files}
    try:
        return DatasetSpec.from_plain(listed.model_dump(include={"name", "experiments", "splits"}), weights)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise DatasetError(
            f"{folder / 'meta/manifest.json'}: experiments: {printable(where)}: {printable(first['msg'])}"
        ) from None
