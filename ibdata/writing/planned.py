"""What a manifest lists must follow from its experiments."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Any

from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.errors import DatasetError
from ibdata.experiment.code import user_objects
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.writing.finish import metadata_files, planned_entry


def refuse_other_plan(spec: DatasetSpec, listed: Manifest) -> None:
    """Raise DatasetError if what a manifest lists does not follow from its experiments."""
    for rule, message in plan_problems(spec, listed):
        raise DatasetError(f"{manifest.PATH}: {rule}: {message}; see ibdata validate")


def plan_problems(spec: DatasetSpec, listed: Manifest) -> Iterator[tuple[str, str]]:
    """The rules that a manifest breaks, each with what was found and expected."""
    shards = [entry.model_dump(exclude={"path", "content"}) for entry in listed.shards]
    files = {file.path for file in listed.files} - {manifest.REPORT}
    targets = list(dict.fromkeys(code.target for code in listed.code))
    for rule, found, expected in (
        ("experiments", {"shards": shards}, {"shards": [planned_entry(spec, each) for each in spec.shards]}),
        ("rows", listed.rows, spec.rows),
        ("files", sorted(files), sorted({*(s.path for s in listed.shards), *metadata_files(spec, [])})),
        ("code", targets, list(dict.fromkeys(policy.code_target for policy in user_objects(spec)))),
    ):
        if message := first_difference(found, expected):
            yield rule, message
    if listed.clipped_actions > listed.rows:
        yield "counts", f"clipped_actions: found {listed.clipped_actions}, expected at most one per row"
    if listed.code and listed.reproducible is True:
        yield "code", 'reproducible: found true, expected "same-environment" or false for custom policies'


def first_difference(found: Any, expected: Any, *keys: object) -> str | None:
    """Describe the first difference of JSON data, which are at `keys`; None if they are equal.

    >>> first_difference({"a": [1, 2]}, {"a": [1, 3]})
    'a.1: found 2, expected 3'
    """
    pairs: Iterable[tuple[object, Any, Any]] = ()
    if isinstance(found, dict) and isinstance(expected, dict):
        pairs = [(key, found.get(key), expected.get(key)) for key in {**expected, **found}]
    elif isinstance(found, list) and isinstance(expected, list) and len(found) == len(expected):
        pairs = zip(range(len(found)), found, expected, strict=True)
    elif found != expected or isinstance(found, bool) != isinstance(expected, bool):
        place = f"{'.'.join(map(str, keys))}: " if keys else ""
        return f"{place}found {_shown(found)}, expected {_shown(expected)}"
    for key, a, b in pairs:
        if inner := first_difference(a, b, *keys, key):
            return inner
    return None


def _shown(value: Any) -> str:
    return f"{len(value)} values" if isinstance(value, list) else json.dumps(value)[:60]
