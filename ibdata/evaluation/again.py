"""An evaluation that was saved as JSON, played again. The file may be a stranger's."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from math import isclose
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ibdata._system.files import plain_bytes
from ibdata.dataset.models import Sha256
from ibdata.errors import UsageError, excerpt, printable
from ibdata.evaluation import evaluate
from ibdata.evaluation.algorithms import Algorithm, printed
from ibdata.evaluation.baselines import DEFAULTS
from ibdata.evaluation.policies import block_policy
from ibdata.evaluation.results import Evaluation
from ibdata.evaluation.saving import TABLE_LAYOUT, set_root, sha256_of
from ibdata.experiment.scenario import scenario_of
from ibdata.policies import Policy
from ibdata.policies.user_object import Custom, ObjectPolicy
from ibdata.policies.weights_file import MAX_BYTES, SHIPPED, Weights, name_in_dataset

MOST_BYTES, MOST_POLICIES = 2**26, 200
MOST_STEPS = 10**9  # of all policies together, which takes some minutes or hours


class _Record(BaseModel):
    model_config = ConfigDict(strict=True)


class _Recorded(_Record):
    policy: dict[str, Any]
    networks: dict[Sha256, Annotated[str, Field(pattern=r"^[^/\\:\x00-\x1f]{1,255}$")]]
    returns_sha256: Sha256


class _Saved(_Record):
    layout: Literal["ibdata-table-1"]
    set_content_root: Sha256 | None
    settings: dict[str, Any]
    groups: dict[str, list[_Recorded]]
    algorithms: list[dict[str, str | float | None]]


def evaluate_again(
    path: Path, files: Sequence[Path], allow_code: bool, progress: bool | None
) -> tuple[Evaluation, list[str]]:
    """Play again what was saved in a file, and say what differs, a line each.

    Networks are sought by name and SHA-256 beside the file and among these files and folders. Their returns
    must have the same bits; those of custom code may differ where the printed table does not. Raises
    UsageError for another file, one that asks for too much, and a network that is missing or another one.
    """
    saved = _read(path)
    recorded = [each for group in saved.groups.values() for each in group]
    scenario = scenario_of(**{name: saved.settings.get(name) for name in DEFAULTS if name != "discount"})
    steps = len(recorded) * len(scenario.points) * scenario.episodes * scenario.steps
    names = {sha256: name for each in recorded for sha256, name in each.networks.items()}
    if max(len(recorded), len(names)) > MOST_POLICIES or steps > MOST_STEPS:
        asked = f"{len(recorded)} policies, {len(names)} networks and {steps:,} steps"
        raise UsageError(f"{path}: found {asked}, expected at most {MOST_POLICIES} each and {MOST_STEPS:,}")
    weights = _weights(path, names, [path.parent, *files, SHIPPED])
    policies = {
        label: [_policy(path, each.policy, weights) for each in group]
        for label, group in saved.groups.items()
    }
    options: dict[str, Any] = {name: saved.settings.get(name) for name in (*DEFAULTS, "against", "view")}
    found = evaluate(policies, **options, allow_code=allow_code, progress=progress)
    return found, list(_problems(saved, recorded, found))


def _read(path: Path) -> _Saved:
    try:
        return _Saved.model_validate_json(plain_bytes(path, MOST_BYTES))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        problem = printable(f"{'.'.join(map(str, first['loc']))}: {first['msg']}")
        raise UsageError(f"{path}: {problem}; expected a file of layout {TABLE_LAYOUT}") from None


def _weights(path: Path, names: Mapping[str, str], places: Sequence[Path]) -> dict[str, Weights]:
    """Networks by their SHA-256, from files of these names, which are hashed before they are parsed."""
    known: dict[str, Weights] = {}
    for sha256, name in names.items():
        files = [place / name if place.is_dir() else place for place in places]
        try:
            contents = [plain_bytes(file, MAX_BYTES) for file in files if file.name == name and file.exists()]
            by_hash = {hashlib.sha256(data).hexdigest(): data for data in contents}
            known |= {sha256: Weights(by_hash[sha256], name)} if sha256 in by_hash else {}
        except (OSError, ValueError) as error:
            raise UsageError(f"{path}: {printable(name)}: cannot be used: {error}") from None
        if sha256 not in known:
            found = (
                f"SHA-256 {min(by_hash)}" if by_hash else "no such file beside it or among the files given"
            )
            raise UsageError(f"{path}: {printable(name)}: found {found}, expected SHA-256 {sha256}")
    return known


def _policy(path: Path, block: dict[str, Any], weights: dict[str, Weights]) -> Policy:
    """The policy of a block, whose networks are among these."""
    for part in _mappings(block):
        known = weights.get(str(part.get("sha256")))
        if "file" in part and (known is None or part["file"] != name_in_dataset(known.sha256)):
            raise UsageError(
                f"{path}: found {excerpt(part['file'])} in a policy, which is none of its networks"
            )
    policy = block_policy(block, str(path), path.parent.absolute(), weights)
    if any(policy.everywhere(ObjectPolicy)):
        raise UsageError(
            f"{path}: found an object of a Python session, which is no more; evaluate what "
            "ibdata.save_network writes of it"
        )
    return policy


def _mappings(value: Any) -> Iterator[dict[str, Any]]:
    """Yield the mappings in a block, but for the parameters of custom code."""
    if isinstance(value, dict):
        yield value
        value = [item for name, item in value.items() if name != "params"]
    for item in value if isinstance(value, list) else ():
        yield from _mappings(item)


def _problems(saved: _Saved, recorded: Sequence[_Recorded], found: Evaluation) -> Iterator[str]:
    if (root := set_root(found)) != saved.set_content_root:
        yield f"content root of the set: found {root}, expected {saved.set_content_root}"
    members = [pair for policies in found.groups.values() for pair in policies.items()]
    only_code_differs = False
    for (label, policy), each, returns in zip(members, recorded, found.returns, strict=True):
        if sha256_of(returns) != each.returns_sha256:
            only_code_differs = any(policy.everywhere(Custom))
            if not only_code_differs:
                yield f"{label}: found other returns, with the mean {returns.mean():.6g}"
                return
    lines = [Algorithm(*map(line.get, Algorithm._fields)) for line in saved.algorithms]  # type: ignore[arg-type]
    if only_code_differs:
        if printed(lines, wide=True) != printed(found.algorithms, wide=True):
            yield "the table of custom code: found other numbers than were printed"
    elif len(lines) != len(found.algorithms):
        yield f"the table: found {len(found.algorithms)} lines, expected {len(lines)}"
    else:
        for here, there in zip(found.algorithms, lines, strict=True):
            for name, one, other in zip(Algorithm._fields, here, there, strict=True):
                if one != other and not (
                    type(one) is type(other) is float and isclose(one, other, abs_tol=1e-6)
                ):
                    yield printable(f"{here.algorithm}: {name}: found {one!r}, expected {other!r:.80}")
