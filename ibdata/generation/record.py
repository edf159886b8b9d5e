"""The record of a run: hashes of its policies' code, and of the bits that its machine computes.

It is noted in the run before the first shard. Whoever makes a shard must have the same record:
a process that goes on with the run, a worker, a range of an array job.
"""

from __future__ import annotations

import hashlib
import sys
from base64 import b64decode, b64encode
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from ibdata._simulation.carry import begin
from ibdata._simulation.unroll import unroll
from ibdata._system.part import NOTE
from ibdata._system.runs import Run, note_of
from ibdata._system.signals import check
from ibdata.dataset import manifest
from ibdata.dataset.models import Code, Count, JsonObject, Sha256, Unchecked, parse
from ibdata.dataset.statistics import moments
from ibdata.errors import DatasetError, UsageError, notice
from ibdata.experiment import Experiment
from ibdata.experiment.scenario import other_dynamics
from ibdata.generation.metadata import as_json
from ibdata.plan.code_record import changed, changed_here, code_record, names_of
from ibdata.plan.dataset_spec import DatasetSpec
from ibdata.plan.rollout import episodes_of, rollout
from ibdata.policies.user_object import UserObject, refuse_shared
from ibdata.views.variables import ROWS

STEPS, SETPOINTS = 100, 32  # at most, that users' objects play before a run
UNREADABLE = "whose note is damaged, or of another ibdata"
OTHER_BITS = "of a machine that computes other bits"
OTHER_BITS_HERE = "this machine computes other bits than expected"


class Planned(JsonObject):
    """What `DatasetSpec.plain` gives."""

    name: str
    experiments: Annotated[list[Unchecked], Field(min_length=1)]


class Record(JsonObject):
    """What a run makes, and with what: the experiments, the code of their policies, and a machine's bits.

    A copy of other datasets has their content roots in place of a machine's bits. `manifest` is the checksum
    of the dataset once that is finished.
    """

    data_version: Count
    spec: Planned
    weights: dict[str, str]  # of its networks, in base64
    shards: Count
    code: list[Code]
    reproducible: bool
    known_answer: Sha256 | None = None  # of the machine's self-check
    sources: list[Sha256] | None = None  # content roots
    clipped: Count | None = None  # actions, where their number is not known from the rows
    manifest: Sha256 | None = None
    live: bool  # whether an object of a Python session acts in it

    @classmethod
    def of(cls, spec: DatasetSpec, **more: Any) -> Record:
        """The record of a run that makes the dataset of a specification."""
        weights = {name: b64encode(data).decode() for name, data in spec.weights.items()}
        return cls(
            data_version=manifest.DATA_VERSION,
            spec=Planned(**spec.plain()),
            weights=weights,
            shards=len(spec.shards),
            live=bool(spec.live),
            **more,
        )

    @classmethod
    def read(cls, run: Run) -> Record | None:
        """The record in the note of a run; None if it is damaged, or another ibdata's."""
        try:
            return parse(cls, note_of(run))
        except ValueError:
            return None

    def write(self, run: Run) -> None:
        """Note the record of a run."""
        run.write(NOTE, as_json(self))

    def dataset_spec(self) -> DatasetSpec:
        """The specification of what the run makes. Raises DatasetError if another ibdata began the run."""
        try:
            weights = {name: b64decode(text) for name, text in self.weights.items()}
            if self.data_version == manifest.DATA_VERSION:
                return DatasetSpec.from_plain(self.spec.plain(), weights)
        except ValueError:
            pass
        raise DatasetError("found an unfinished run of another ibdata; finish it with that")

    def difference(self, spec: DatasetSpec, mine: Record | None) -> str | None:
        """How this run differs from one that makes a dataset here; None if that can go on with it.

        As long as that has no record, the files of its code are compared, and no bits.
        """
        if self.data_version != manifest.DATA_VERSION:
            version = f"found {self.data_version}, expected {manifest.DATA_VERSION}"
            return f"of another experiment (data version: {version})"
        if difference := spec.difference(self.spec.name, self.spec.experiments):
            return f"of another experiment ({difference})"
        if self.sources != (mine and mine.sources):
            return "of other datasets"
        if names := changed(self.code, mine.code) if mine else changed_here(spec, self.code):
            return f"with other code, in {names_of(names)}"
        return OTHER_BITS if mine and mine.known_answer != self.known_answer else None


def observe(spec: DatasetSpec) -> Record:
    """The record of a run here: load its policies, play two steps, and list what was imported.

    What a user should know about its policies is said on stderr.
    """
    code, answer = _code(spec), known_answer()
    if answer != KNOWN_ANSWER:
        notice(f"{OTHER_BITS_HERE}; the manifest says reproducible: false")
    reproducible = answer == KNOWN_ANSWER and not spec.live
    record = Record.of(spec, code=code, reproducible=reproducible, known_answer=answer)
    if spec.user_objects:
        for experiment in spec.experiments:
            _play_user_objects(experiment)
    for user_object in spec.user_objects:
        for note in user_object.notes():
            notice(f"{user_object.code_target}: {note}")
    for experiment in spec.experiments:
        played = [*zip(experiment.labels, experiment.policies, strict=True)]
        if experiment.output.expert_action:
            played.append(("output.expert_action", experiment.scenario.expert))
        for label, policy in played:
            for note in other_dynamics(policy, experiment.scenario):
                notice(f"{label}: {note}")
    return record


def _code(spec: DatasetSpec) -> list[Code]:
    policies = spec.user_objects
    for policy in policies:
        policy.refuse_impure()
    for experiment in spec.experiments if policies else ():
        for policy_of_label in experiment.policies:
            refuse_shared(policy_of_label)
    for experiment in spec.experiments:
        warm_up(experiment)
    return code_record(policies)


def agree(spec: DatasetSpec, run: Run) -> None:
    """Raise UsageError if the record of this worker is not that of the run.

    Without a note, as in `repair`, which compares the shards themselves, nothing is compared.
    """
    begun = Record.read(run)
    if begun is None:
        return
    if names := changed(begun.code, _code(spec)):
        raise UsageError(f"a worker found other code than the run began with, in {names_of(names)}")
    if begun.known_answer != known_answer():
        raise UsageError("a worker computes other bits than the machine on which the run began")


def warm_up(experiment: Experiment) -> None:
    """Compile the simulator before workers start: two steps of each policy, and their statistics."""
    small = experiment.part(steps=2, episodes=1)
    per_policy = small.episodes_per_policy
    for first in range(0, small.episode_count, per_policy):
        moments(rollout(small, first, first + 1).table)
    check()


def warm_up_again(spec: DatasetSpec) -> None:
    """Compile the simulator before episodes are made again, and say so if this machine makes others."""
    for experiment in spec.experiments:
        warm_up(experiment)
    if known_answer() != KNOWN_ANSWER:
        notice(f"{OTHER_BITS_HERE}; episodes made again may differ")


def _play_user_objects(experiment: Experiment) -> None:
    """Let users' objects act in the first steps, since they count how many of their numbers are clipped."""
    small = experiment.part(steps=min(experiment.steps, STEPS), episodes=1)
    per_policy = small.episodes_per_policy
    for number, policy in enumerate(small.policies):
        if any(policy.everywhere(UserObject)):
            rollout(small, number * per_policy, number * per_policy + min(per_policy, SETPOINTS))


# Small runs with a known result show whether this machine computes the same bits as all others. They use
# only the compiled code that every dataset needs.
KNOWN: dict[str, Any] = {"name": "known", "policies": [{"kind": "random"}], "episodes": 16, "steps": 32}
MOVING = {**KNOWN, "dynamics": "siemens", "setpoints": {"drifting": [1, 35, 70, 99]}, "start": "uniform"}
PRINTED = {**KNOWN, "dynamics": "paper", "setpoints": [1, 99]}
KNOWN_ANSWER = "ce080c3df2a134ce619f7adcddff13a769bfddabe30a0a6c86388358b13ad5d6"


def digest(plain: dict[str, Any]) -> bytes:
    """The SHA-256 of a known run's actions and of its states, of which float32 would hide the last bits."""
    known = Experiment.model_validate(plain)
    episodes = episodes_of(known, np.arange(known.episode_count))
    blocks = unroll(episodes, begin(episodes), np.arange(len(ROWS)), known.steps)
    parts = [(block.record[:, 1:].astype("<f8"), block.actions.astype("<f4")) for block in blocks]
    states = np.concatenate([states for states, _ in parts], axis=1)
    actions = np.concatenate([actions for _, actions in parts])
    return hashlib.sha256(states.tobytes() + actions.tobytes()).digest()


def known_answer() -> str:
    """The SHA-256 of the results of the known runs in this process, and of its treatment of denormals."""
    least = sys.float_info.min
    keeps_denormals = least / 2.0 * 2.0 == least  # a library can tell the processor to treat them as 0
    digests = digest(MOVING) + digest(PRINTED)
    check()
    return hashlib.sha256(digests + bytes([keeps_denormals])).hexdigest()
