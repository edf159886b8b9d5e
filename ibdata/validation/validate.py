"""Check that the files, rows and metadata of a dataset are those that its manifest promises."""

from __future__ import annotations

import os
from collections.abc import Iterator

from ibdata.arguments import public
from ibdata.dataset import manifest
from ibdata.dataset.stored import Stored
from ibdata.errors import DatasetError
from ibdata.experiment.dataset_spec import declared_spec
from ibdata.system.progress import Advance, bar
from ibdata.system.storage import existing, storage
from ibdata.validation.derived import metadata_problems, splits_problems
from ibdata.validation.files import Hashing, check_files, unlisted_files
from ibdata.validation.rows import check_shard
from ibdata.validation.rules import Findings, Problem
from ibdata.writing.finish import root_of
from ibdata.writing.planned import plan_problems
from ibdata.writing.shard_writer import WrittenShard
from ibdata.writing.summary import content_of


@public
def validate(
    folder: str | os.PathLike[str], quick: bool = False, *, progress: bool | None = False
) -> Findings:
    """Find every problem of a dataset, without running any code of the dataset.

    1. The SHA-256 of every file that the manifest lists is compared. Other files in `data` are problems too.
    2. Every row is checked by the rules: schema, no nulls, finite, bounds, indices, flags, policy,
       continuity, reward, setpoint, steering, shift register, density.
    3. The digests of the episodes and the content root are computed again from the rows, and compared.
    4. So is what follows from the experiments and the rows: shards, columns, counts, splits, table of
       episodes, statistics. Values are compared, not bytes.

    README.md and report.html are yours to edit, and are not checked.

    Args:
        folder: A folder or a URL, as in `open`.
        quick: Compare only the SHA-256 of the files, and the splits, whose file has none.
        progress: Whether to show a bar on stderr; None shows it if stderr is a terminal.

    Returns:
        The problems, a list that is empty if there are none, and that notebooks show as a table.

    Raises:
        BusyError: The dataset was replaced while it was read.
    """
    place = storage(existing(folder))
    try:
        stored = Stored.open(place)
    except DatasetError as error:
        return Findings([Problem.of(error, manifest.PATH, place.where(manifest.PATH), "manifest")])
    check = _quickly if quick else _fully
    problems = Findings(check(stored, progress))
    stored.refuse_replaced()
    return problems


def _quickly(stored: Stored, progress: bool | None) -> Iterator[Problem]:
    with bar(progress, len(stored.manifest.files), "files") as advance:
        yield from check_files(stored, advance)
    yield from splits_problems(stored)


def _fully(stored: Stored, progress: bool | None) -> Iterator[Problem]:
    with Hashing(stored) as files, bar(progress, stored.manifest.rows, "rows") as advance:
        contents = list(_contents(stored, files, advance))
        yield from files.problems()
    yield from unlisted_files(stored)
    yield from contents


def _contents(stored: Stored, files: Hashing, advance: Advance) -> Iterator[Problem]:
    """The problems with what whole files hold."""
    listed = stored.manifest
    try:
        spec = declared_spec(stored)
    except DatasetError as error:
        yield Problem.of(error, manifest.PATH, stored.storage.where(manifest.PATH), "manifest")
        return
    plan = [Problem(manifest.PATH, None, rule, message) for rule, message in plan_problems(spec, listed)]
    yield from plan
    if any(problem.rule in ("experiments", "files") for problem in plan):
        return
    entries, written = listed.entries(), list[WrittenShard]()
    for shard, one in zip(spec.shards, listed.shards, strict=True):
        if not files.is_whole(one.path):
            continue
        summary, problems = check_shard(spec, shard, stored.storage, one.path, advance)
        yield from problems
        if summary is not None:
            written.append(WrittenShard(shard, entries[one.path], summary))
            if content_of(summary.digests) != one.content:
                yield Problem(one.path, None, "digest", "found other content than the manifest lists")
    if len(written) == len(spec.shards):
        root = root_of(spec, ((w.shard, w.content.digests) for w in written))
        if root != listed.content_root:
            message = f"found {listed.content_root}, expected {root}"
            yield Problem(manifest.PATH, None, "content root", message)
    yield from metadata_problems(stored, spec, written, files.is_whole)
    yield from splits_problems(stored)
