"""What a manifest lists must follow from its experiments."""

from __future__ import annotations

from collections.abc import Iterator

from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.errors import DatasetError
from ibdata.experiment.code import customs
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.writing.finish import metadata_files, planned_entry
from ibdata.writing.json_difference import first_difference


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
        ("code", targets, list(dict.fromkeys(custom.target for custom in customs(spec)))),
    ):
        if message := first_difference(found, expected):
            yield rule, message
    if listed.clipped_actions > listed.rows:
        yield "counts", f"clipped_actions: found {listed.clipped_actions}, expected at most one per row"
    if listed.code and listed.reproducible is True:
        yield "code", 'reproducible: found true, expected "same-environment" or false for custom policies'
