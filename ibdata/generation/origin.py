"""The origin of a run: hashes of its policies' code, and of the bits that its machine computes.

It is noted before the first shard. Every process that makes a shard must have the same origin: one that
resumes the run, a worker, a range of an array job.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

from ibdata.dataset.models import Code, JsonObject, Sha256, parse
from ibdata.errors import UsageError
from ibdata.experiment.code_comparison import code_hashes, listed
from ibdata.experiment.code_record import imported_late, provenance
from ibdata.experiment.custom_code import customs
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fresh_modules import forget_modules, in_one_folder
from ibdata.generation import receipt
from ibdata.generation.warm_up import known_answer, warm_up
from ibdata.simulation import self_check
from ibdata.system.atomic_files import create_or_compare, plain_bytes, write
from ibdata.system.object_store import is_url
from ibdata.writing.metadata import as_json

PATH = f"{receipt.FOLDER}/run.json"
MAX_BYTES = 2**20
Parts = dict[str, str | None]  # hashes and versions that are compared, by the names that messages give them


class Origin(JsonObject):
    """The origin of a run: the answer of its machine's self-check, and the code of its custom policies."""

    known_answer: Sha256
    code: list[Code]

    @property
    def reproducible(self) -> bool:
        """Whether the machine computes the same bits as all others."""
        return self_check.is_right(self.known_answer)

    def note(self) -> bytes:
        """The bytes of the file that notes it."""
        return as_json(self)


def observe(spec: DatasetSpec, where: Path | str) -> Origin:
    """Determine the origin of a run: hash its code before any of it runs, then import all of it.

    Raises UsageError if the code changed meanwhile.
    """
    found = _imported(spec, provenance(customs(spec)), where)
    return Origin(known_answer=known_answer(), code=found)  # importing may change what the processor does


def _imported(spec: DatasetSpec, code: list[Code], where: Path | str) -> list[Code]:
    """Import all policies and play two steps; return their code. Raises UsageError if it changed meanwhile.

    What was found only by importing or playing is part of it.
    """
    for policy in customs(spec):
        policy.load()
    for experiment in spec.experiments:
        warm_up(experiment)
    found = provenance(customs(spec))
    _refuse_parts(_parts(code), _parts(found), _parts(code), where)
    return found


def begin(root: Path, origin: Origin, where: Path | str) -> None:
    """Note the origin of a run. Raises UsageError if existing shards have another origin."""
    if any((root / receipt.FOLDER).glob("*.receipt")):
        _refuse_other(get(root, where), origin, where)
    else:
        write(root, PATH, origin.note())


def begin_range(root: Path, origin: Origin, where: Path | str) -> None:
    """As `begin`, but other ranges may begin at the same time; the first one notes the origin for all."""
    if not create_or_compare(root, PATH, origin.note()):
        _refuse_other(get(root, where), origin, where)


def begun(root: Path) -> bytes | None:
    """The bytes of an unfinished run's note; None if there is none."""
    path = root / PATH
    if not path.is_file():
        return None
    try:
        return plain_bytes(path, MAX_BYTES)
    except OSError:
        return b""


def get(root: Path, where: Path | str) -> Origin:
    """Read the origin of an unfinished run. Raises UsageError if its note is missing or damaged."""
    try:
        return parse(Origin, json.loads(begun(root) or b""))
    except ValueError:
        raise UsageError(
            f"{where}/{PATH}: missing or damaged, so the code that made the shards is unknown; "
            "start again with --overwrite or another --out"
        ) from None


_agreed: list[bytes] = []  # the note with which this process was compared last


def agree(root: Path, spec: DatasetSpec) -> None:
    """Raise UsageError if the origin of this worker is not that of the run.

    Each run is compared once, because its process keeps what it has imported. Without a note, as in
    `repair`, which compares the shards themselves, nothing is compared.
    """
    note = begun(root)
    if note is None or [note] == _agreed:
        return
    origin = get(root, root)
    forget_modules(customs(spec))  # of another run of Ray's, or of the script that a new process begins with
    code = _imported(spec, origin.code, root)
    _refuse_other(origin, Origin(known_answer=self_check.answer(), code=code), root)
    _agreed[:] = [note]


def refuse_late_imports(root: Path, spec: DatasetSpec) -> None:
    """Raise UsageError if a policy has imported code that the note of the run does not have."""
    late = imported_late(get(root, root).code) if customs(spec) and begun(root) is not None else []
    if late:
        raise UsageError(
            f"{root}: found code that a policy imported while it ran, so that it is not recorded: "
            f"{listed(late)}; import it when the policy is loaded, or list its file"
        )


def _refuse_other(began: Origin, here: Origin, where: Path | str) -> None:
    refuse_other_code(began.code, here.code, where)
    if began.known_answer != here.known_answer:
        raise UsageError(
            f"{where}: this machine computes other bits than the one on which the run began, or a library "
            f"has told its processor to; --resume on a machine like that one, {_again(where)}"
        )


def refuse_code_other_than(began: Sequence[Code], spec: DatasetSpec, where: str) -> None:
    """As `refuse_other_code` for the code that is found here before any of it is imported."""
    with in_one_folder(spec):
        found = _parts(provenance(customs(spec)))
    _refuse_parts(_parts(began), found, found, where)


def refuse_other_code(began: Sequence[Code], here: Sequence[Code], where: Path | str) -> None:
    """UsageError where the code here is not that with which a run began."""
    was, found = _parts(began), _parts(here)
    _refuse_parts(was, found, was.keys() | found.keys(), where)


def _refuse_parts(was: Parts, found: Parts, names: Iterable[str], where: Path | str) -> None:
    """Raise UsageError if one of these parts of the code is another."""
    changed = [name for name in names if was.get(name, "") != found.get(name, "")]
    if changed:
        raise UsageError(
            f"{where}: found other code than the run began with, in {listed(changed)}; restore it "
            f"and --resume, {_again(where)}"
        )


def _again(where: Path | str) -> str:
    """How to start again there; --overwrite is for folders."""
    return (
        "or choose another --out"
        if is_url(str(where))
        else "or start again with --overwrite or another --out"
    )


def _parts(code: Sequence[Code]) -> Parts:
    versions = {name: version for each in code for name, version in each.distributions.items()}
    return code_hashes(code) | {f"the version of {name}": version for name, version in versions.items()}
