"""The record of a run: hashes of its policies' code, and of the bits that its machine computes.

It is noted in the part before the first shard. Whoever makes a shard must have the same record: a process
that resumes the run, a worker, a range of an array job.
"""

from __future__ import annotations

import json
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.models import Code, Count, JsonObject, Sha256, parse
from ibdata.dataset.statistics import moments
from ibdata.errors import UsageError, notice
from ibdata.experiment import Experiment, as_yaml, self_check
from ibdata.experiment.code import changed, names_of, record, user_objects, user_objects_in
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.rollout import rollout
from ibdata.experiment.scenario import other_dynamics
from ibdata.policies.live import LIVE
from ibdata.policies.user_object import refuse_shared
from ibdata.system.files import plain_bytes, write, write_new
from ibdata.system.part import NOTE
from ibdata.system.signals import check
from ibdata.writing.metadata import as_json

EXPERIMENT = "experiment.yaml"  # in a part
MAX_BYTES = 2**20
STEPS, SETPOINTS = 100, 32  # at most, that users' objects play before a run


class Record(JsonObject):
    """The record of a run; `manifest` is the checksum of the dataset once that is finished."""

    data_version: Count
    known_answer: Sha256  # of the machine's self-check
    shards: Count
    code: list[Code]
    manifest: Sha256 | None = None

    @classmethod
    def read(cls, root: Path) -> Record | None:
        """The record of the run in a part; None if there is none that can be read."""
        try:
            return parse(cls, json.loads(plain_bytes(root / NOTE, MAX_BYTES)))
        except (OSError, ValueError):
            return None

    def write(self, root: Path) -> None:
        """Note the record in a part."""
        write(root, NOTE, as_json(self))

    def begin(self, root: Path, spec: DatasetSpec) -> None:
        """Note experiment, weights and record of a run in its part, the record last."""
        write_new(root, EXPERIMENT, as_yaml(spec.experiments[0]))
        for name, data in spec.weights.items():
            write_new(root, name, data)
        self.write(root)

    @property
    def reproducible(self) -> bool:
        """Whether the run can be repeated, and the machine computes the same bits as all others."""
        live = any(code.target.startswith(LIVE) for code in self.code)
        return self_check.is_right(self.known_answer) and not live


def observe(spec: DatasetSpec) -> Record:
    """The record of a run here: load its policies, play two steps, and list what was imported.

    What a user should know about its policies is said on stderr.
    """
    record = Record(
        data_version=manifest.DATA_VERSION,
        shards=len(spec.shards),
        code=_code(spec),
        known_answer=known_answer(),
    )
    if user_objects(spec):
        for experiment in spec.experiments:
            _play_user_objects(experiment)
    for user_object in user_objects(spec):
        for note in user_object.notes():
            notice(f"{user_object.code_target}: {note}")
    for experiment in spec.experiments:
        for label, policy in zip(experiment.labels, experiment.policies, strict=True):
            for note in other_dynamics(policy, experiment.scenario):
                notice(f"{label}: {note}")
    return record


def _code(spec: DatasetSpec) -> list[Code]:
    policies = user_objects(spec)
    for policy in policies:
        policy.check_once()
    for experiment in spec.experiments:
        for policy_of_label in experiment.policies:
            refuse_shared(policy_of_label)
    for experiment in spec.experiments:
        warm_up(experiment)
    return record(policies)


def difference(root: Path, experiment: Experiment, here: Record | None) -> str | None:
    """How the run in a part differs from one of an experiment here, in words; None if it does not.

    Without a record of this process, only the experiments are compared.
    """
    begun = Record.read(root)
    if begun is None or begun.data_version != manifest.DATA_VERSION:
        return "of another experiment"
    if (root / EXPERIMENT).read_bytes() != as_yaml(experiment):
        return "of another experiment"
    if here is None:
        return None
    if names := changed(begun.code, here.code):
        return f"with other code, in {names_of(names)}"
    if begun.known_answer != here.known_answer:
        return "of a machine that computes other bits"
    return None


def agree(spec: DatasetSpec, root: Path) -> None:
    """Raise UsageError if the record of this worker is not that of the run in a part.

    Without a note, as in `repair`, which compares the shards themselves, nothing is compared.
    """
    begun = Record.read(root)
    if begun is None:
        return
    if names := changed(begun.code, _code(spec)):
        raise UsageError(f"a worker found other code than the run began with, in {names_of(names)}")
    if begun.known_answer != self_check.answer():
        raise UsageError("a worker computes other bits than the machine on which the run began")


def warm_up(experiment: Experiment) -> None:
    """Compile the simulator before workers start: two steps of each policy, and their statistics."""
    small = experiment.part(steps=2, episodes=1)
    per_policy = small.episodes_per_policy
    for first in range(0, small.episode_count, per_policy):
        moments(rollout(small, first, first + 1).table)
    check()


def _play_user_objects(experiment: Experiment) -> None:
    """Let users' objects act in the first steps, since they count how many of their numbers are clipped."""
    small = experiment.part(steps=min(experiment.steps, STEPS), episodes=1)
    per_policy = small.episodes_per_policy
    for number, policy in enumerate(small.policies):
        if any(user_objects_in(policy)):
            rollout(small, number * per_policy, number * per_policy + min(per_policy, SETPOINTS))


def known_answer(therefore: str = "the manifest says reproducible: false") -> str:
    """Make the known runs and return their `answer`. If the bits are not right, a line on stderr says so."""
    answer = self_check.answer()
    check()
    if not self_check.is_right(answer):
        notice(f"this machine computes other bits than expected; {therefore}")
    return answer
