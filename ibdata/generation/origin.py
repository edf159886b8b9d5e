"""The origin of a run: hashes of its policies' code, and of the bits that its machine computes.

It is noted in the part before the first shard. Whoever makes a shard must have the same origin: a process
that resumes the run, a worker, a range of an array job.
"""

from __future__ import annotations

import json
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.models import Code, Count, JsonObject, Sha256, parse
from ibdata.errors import UsageError, notice
from ibdata.experiment import Experiment, as_yaml, self_check
from ibdata.experiment.code import changed, names_of, record, user_objects
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.scenario import other_dynamics
from ibdata.generation.warm_up import known_answer, play_user_objects, warm_up
from ibdata.policies.live import LIVE
from ibdata.policies.user_object import refuse_shared
from ibdata.system.files import plain_bytes, write, write_new
from ibdata.system.part import NOTE
from ibdata.writing.metadata import as_json

PATH, EXPERIMENT = NOTE, "experiment.yaml"  # in a part
MAX_BYTES = 2**20


class Origin(JsonObject):
    """The origin of a run; `manifest` is the checksum of the dataset once that is finished."""

    data_version: Count
    known_answer: Sha256  # of the machine's self-check
    shards: Count
    code: list[Code]
    manifest: Sha256 | None = None

    @property
    def reproducible(self) -> bool:
        """Whether the run can be repeated, and the machine computes the same bits as all others."""
        live = any(each.target.startswith(LIVE) for each in self.code)
        return self_check.is_right(self.known_answer) and not live


def observe(spec: DatasetSpec) -> Origin:
    """Determine the origin of a run: load its policies, play two steps, and record what was imported.

    What a user should know about its policies is said on stderr.
    """
    origin = Origin(
        data_version=manifest.DATA_VERSION,
        shards=len(spec.shards),
        code=_code(spec),
        known_answer=known_answer(),
    )
    if user_objects(spec):
        for experiment in spec.experiments:
            play_user_objects(experiment)
    for user_object in user_objects(spec):
        for note in user_object.notes():
            notice(f"{user_object.code_target}: {note}")
    for experiment in spec.experiments:
        for label, policy in zip(experiment.labels, experiment.policies, strict=True):
            for note in other_dynamics(policy, experiment.scenario):
                notice(f"{label}: {note}")
    return origin


def _code(spec: DatasetSpec) -> list[Code]:
    policies = user_objects(spec)
    for policy in policies:
        policy.check_once()
    for experiment in spec.experiments:
        for acting in experiment.policies:
            refuse_shared(acting)
    for experiment in spec.experiments:
        warm_up(experiment)
    return record(policies)


def begin(root: Path, spec: DatasetSpec, origin: Origin) -> None:
    """Note experiment, weights and origin of a run in its part, the origin last."""
    write_new(root, EXPERIMENT, as_yaml(spec.experiments[0]))
    for name, data in spec.weights.items():
        write_new(root, name, data)
    write(root, PATH, as_json(origin))


def read(root: Path) -> Origin | None:
    """The origin of the run in a part; None if there is none that can be read."""
    try:
        return parse(Origin, json.loads(plain_bytes(root / PATH, MAX_BYTES)))
    except (OSError, ValueError):
        return None


def same_experiment(root: Path, experiment: Experiment) -> bool:
    """Whether the run in a part is that of an experiment, and of this ibdata's data version."""
    began = read(root)
    if began is None or began.data_version != manifest.DATA_VERSION:
        return False
    return (root / EXPERIMENT).read_bytes() == as_yaml(experiment)


def other(root: Path, experiment: Experiment, here: Origin) -> str | None:
    """How the run in a part differs from one of an experiment here, in words; None if it does not."""
    began = read(root)
    if began is None or not same_experiment(root, experiment):
        return "of another experiment"
    if names := changed(began.code, here.code):
        return f"with other code, in {names_of(names)}"
    if began.known_answer != here.known_answer:
        return "of a machine that computes other bits"
    return None


def agree(spec: DatasetSpec, root: Path) -> None:
    """Raise UsageError if the origin of this worker is not that of the run in a part.

    Without a note, as in `repair`, which compares the shards themselves, nothing is compared.
    """
    began = read(root)
    if began is None:
        return
    if names := changed(began.code, _code(spec)):
        raise UsageError(f"a worker found other code than the run began with, in {names_of(names)}")
    if began.known_answer != self_check.answer():
        raise UsageError("a worker computes other bits than the machine on which the run began")
