"""The origin of a run: hashes of its policies' code, and of the bits that its machine computes.

It is noted in the part before the first shard. Whoever makes a shard must have the same origin: a process
that resumes the run, a worker, a range of an array job.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.models import Code, Count, JsonObject, Sha256, parse
from ibdata.errors import UsageError
from ibdata.experiment import Experiment, as_yaml
from ibdata.experiment.code_comparison import code_hashes, listed
from ibdata.experiment.code_record import imported_late, provenance
from ibdata.experiment.custom_code import customs
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fresh_modules import forget_modules, in_one_folder
from ibdata.generation.warm_up import known_answer, warm_up
from ibdata.simulation import self_check
from ibdata.system.files import plain_bytes, write, write_new
from ibdata.writing.metadata import as_json

PATH, EXPERIMENT = "run.json", "experiment.yaml"  # in a part
MAX_BYTES = 2**20
Parts = dict[str, str | None]  # hashes and versions that are compared, by the names that messages give them


class Origin(JsonObject):
    """The origin of a run; `manifest` is the checksum of the dataset once that is finished."""

    data_version: Count
    known_answer: Sha256  # of the machine's self-check
    code: list[Code]
    manifest: Sha256 | None = None

    @property
    def reproducible(self) -> bool:
        """Whether the machine computes the same bits as all others."""
        return self_check.is_right(self.known_answer)


def observe(spec: DatasetSpec, where: Path | str) -> Origin:
    """Determine the origin of a run: hash its code before any of it runs, then import all of it.

    Raises UsageError if the code changed meanwhile.
    """
    found = _imported(spec, provenance(customs(spec)), where)
    answer = known_answer()  # importing may change what the processor does
    return Origin(data_version=manifest.DATA_VERSION, known_answer=answer, code=found)


def _imported(spec: DatasetSpec, code: list[Code], where: Path | str) -> list[Code]:
    """Import all policies and play two steps; return their code. Raises UsageError if it changed meanwhile.

    What was found only by importing or playing is part of it.
    """
    for policy in customs(spec):
        policy.load()
    for experiment in spec.experiments:
        warm_up(experiment)
    found = provenance(customs(spec))
    began = _parts(code)
    changed = _changed(began, _parts(found), began)
    if changed:
        raise UsageError(f"{where}: {listed(changed)} changed while the run began; run again")
    return found


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


def is_published(root: Path) -> bool:
    """Whether the run in a part has ended, or was stopped while its note was removed."""
    began = read(root)
    return began is None or began.manifest is not None


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
    if changed := changed_code(began.code, here.code):
        return f"with other code, in {listed(changed)}"
    if began.known_answer != here.known_answer:
        return "of a machine that computes other bits"
    return None


def changed_code(began: Sequence[Code], here: Sequence[Code]) -> list[str]:
    """The names of files and packages that differ between two records of code."""
    was, found = _parts(began), _parts(here)
    return _changed(was, found, was.keys() | found.keys())


_agreed: list[Origin] = []  # the run with which this process was compared last


def agree(root: Path, spec: DatasetSpec) -> None:
    """Raise UsageError if the origin of this worker is not that of the run.

    Each run is compared once, because its process keeps what it has imported. Without a note, as in
    `repair`, which compares the shards themselves, nothing is compared.
    """
    began = read(root)
    if began is None or [began] == _agreed:
        return
    forget_modules(customs(spec))  # of another run of Ray's
    code = _imported(spec, provenance(customs(spec)), root)
    if changed := changed_code(began.code, code):
        raise UsageError(f"a worker found other code than the run began with, in {listed(changed)}")
    if began.known_answer != self_check.answer():
        raise UsageError("a worker computes other bits than the machine on which the run began")
    _agreed[:] = [began]


def refuse_late_imports(root: Path, spec: DatasetSpec) -> None:
    """Raise UsageError if a policy has imported code that the note of the run does not have."""
    began = read(root) if customs(spec) else None
    late = imported_late(began.code) if began is not None else []
    if late:
        raise UsageError(
            "found code that a policy imported while it ran, so that it is not recorded: "
            f"{listed(late)}; import it when the policy is loaded, or list its file"
        )


def code_here(spec: DatasetSpec) -> list[Code]:
    """The code of custom policies as it is here, before any of it is imported."""
    with in_one_folder(spec):
        return provenance(customs(spec))


def _changed(was: Parts, found: Parts, names: Iterable[str]) -> list[str]:
    return [name for name in names if was.get(name, "") != found.get(name, "")]


def _parts(code: Sequence[Code]) -> Parts:
    versions = {name: version for each in code for name, version in each.distributions.items()}
    return code_hashes(code) | {f"the version of {name}": version for name, version in versions.items()}
