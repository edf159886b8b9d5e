"""The origin of a run: its policies' code and its machine's bits, noted for whoever goes on with it.

The note is written before the first shard, and whatever makes a shard must agree with it: another process,
a worker, a range of an array job.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from ibdata.dataset.models import Code, JsonObject, Sha256, parse
from ibdata.errors import UsageError, printable
from ibdata.experiment.custom_code import customs, forget_modules, in_one_folder, provenance
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.generation import receipt
from ibdata.generation.warm_up import warm_up
from ibdata.simulation import self_check
from ibdata.system.atomic_files import create_or_compare, plain_bytes, write
from ibdata.writing.metadata import as_json

PATH = f"{receipt.FOLDER}/run.json"
MAX_BYTES = 2**20
AGAIN = "or start again with --overwrite or another --out"


class Origin(JsonObject):
    """The hash of the known answer on the machine where a run began, and its custom policies' provenance."""

    known_answer: Sha256
    code: list[Code]

    @property
    def reproducible(self) -> bool:
        """Whether the machine computes the same bits as all others."""
        return self.known_answer == self_check.SHA256

    def note(self) -> bytes:
        """The bytes of its note."""
        return as_json(self)


def observe(spec: DatasetSpec, where: Path) -> Origin:
    """Observe the origin of a run: its code is hashed before any of it runs, then all of it is imported.

    Raises UsageError where it changed meanwhile.
    """
    folder = spec.experiments[0].folder
    code = provenance(spec, folder)
    for experiment in spec.experiments:
        warm_up(experiment)
    return _imported(spec, folder, code, where)


def _imported(spec: DatasetSpec, folder: Path | None, code: list[Code], where: Path) -> Origin:
    """Import all policies; return the origin. Raises UsageError where their code changed meanwhile."""
    for policy in customs(spec):
        policy.load()
    refuse_other_code(code, provenance(spec, folder), where)
    return Origin(known_answer=self_check.digest(), code=code)


def begin(root: Path, origin: Origin, where: Path) -> None:
    """Write the note of a run; UsageError where existing shards have another origin."""
    if any((root / receipt.FOLDER).glob("*.receipt")):
        _refuse_other(get(root, where), origin, where)
    else:
        write(root, PATH, origin.note())


def begin_range(root: Path, origin: Origin, where: Path) -> None:
    """As `begin`, while other ranges may begin: the first to begin decides, even before its first shard."""
    if not create_or_compare(root, PATH, origin.note()):
        _refuse_other(get(root, where), origin, where)


def begun(root: Path) -> bytes | None:
    """The bytes of an unfinished run's note; None where there is none."""
    path = root / PATH
    if not path.is_file():
        return None
    try:
        return plain_bytes(path, MAX_BYTES)
    except OSError:
        return b""


def get(root: Path, where: Path) -> Origin:
    """Read the origin of an unfinished run; UsageError where its note is missing or damaged."""
    try:
        return parse(Origin, json.loads(begun(root) or b""))
    except ValueError:
        raise UsageError(
            f"{where / PATH}: missing or damaged, so nobody knows what code made the shards; "
            "start again with ibdata generate --overwrite or another --out"
        ) from None


_agreed: list[bytes] = []  # the note with which this process was compared last


def agree(root: Path, spec: DatasetSpec, folder: Path | None) -> None:
    """In a worker, before a shard: UsageError where its code or its bits are not those of the run.

    Once for each run: what it has imported stays until then. A folder without a note is one that proves
    shards otherwise.
    """
    note = begun(root)
    if note is None or [note] == _agreed:
        return
    origin = get(root, root)
    forget_modules(spec)  # of another run of Ray's, or of the script that a new process begins with
    _refuse_other(origin, _imported(spec, folder, origin.code, root), root)
    _agreed[:] = [note]


def _refuse_other(began: Origin, here: Origin, where: Path) -> None:
    refuse_other_code(began.code, here.code, where)
    if began.known_answer != here.known_answer:
        raise UsageError(
            f"{where}: found a machine that computes other bits than the one on which the run began; "
            f"--resume on one like that, {AGAIN}"
        )


def refuse_code_other_than(began: Sequence[Code], spec: DatasetSpec, where: str) -> None:
    """As `refuse_other_code`, before any of the code here is imported."""
    with in_one_folder(spec):
        refuse_other_code(began, provenance(spec, spec.experiments[0].folder), where)


def refuse_other_code(began: Sequence[Code], here: Sequence[Code], where: Path | str) -> None:
    """UsageError where the code here is not that with which a run began."""
    was, found = _parts(began), _parts(here)
    changed = sorted(name for name in was.keys() | found.keys() if was.get(name, "") != found.get(name, ""))
    if changed:
        raise UsageError(
            f"{where}: found other code than the run began with, in {printable(', '.join(changed[:8]))}; "
            f"put back what was there and --resume, {AGAIN}"
        )


def _parts(code: Sequence[Code]) -> dict[str, str | None]:
    """All hashes and versions that are compared, by a name for messages."""
    parts: dict[str, str | None] = {}
    for each in code:
        parts |= {each.target: each.sha256, **each.files}
        parts |= {f"the version of {name}": version for name, version in each.distributions.items()}
    return parts
