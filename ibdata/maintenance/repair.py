"""Repairing a dataset: damaged and missing files are made again and compared with the manifest's digests."""

from __future__ import annotations

import os
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.episodes import PATH as EPISODES
from ibdata.dataset.episodes import read_episodes
from ibdata.dataset.models import Manifest
from ibdata.dataset.strangers import strangers
from ibdata.errors import DatasetError, UsageError
from ibdata.experiment import as_yaml, load
from ibdata.experiment.code_record import provenance
from ibdata.experiment.custom_code import customs, require_consent
from ibdata.experiment.dataset_spec import DatasetSpec, spec_in
from ibdata.experiment.fresh_modules import in_one_folder
from ibdata.experiment.plan import Shard
from ibdata.generation import local, output_folder, replacement
from ibdata.generation.engine import refuse_workers
from ibdata.generation.warm_up import known_answer, warm_up
from ibdata.maintenance.evidence import file_with, refuse_unproven
from ibdata.simulation import self_check
from ibdata.system.atomic_files import FileEntry, file_sha256, sync_folder, write
from ibdata.system.guard import writing_to
from ibdata.system.lock import refuse_busy
from ibdata.system.signals import check
from ibdata.system.storage import refuse_url
from ibdata.validation.files import check_files
from ibdata.version import __version__
from ibdata.writing.finish import finish, metadata_files, rewritten_manifest
from ibdata.writing.planned import refuse_other_plan
from ibdata.writing.shard_writer import WrittenShard
from ibdata.writing.stored import stored_content
from ibdata.writing.summary import UNREAD, content_of, describe, simulated

NEEDS_CONTENT = {EPISODES, "meta/statistics.json"}


def repair(folder: str | os.PathLike[str], workers: int | None = None, allow_code: bool = False) -> list[str]:
    """Make the damaged and missing files of a dataset again, and only them.

    A file is replaced only if its rows, or the rows that its metadata describe, have the content that the
    manifest lists. A damaged manifest is made again from meta/experiment.yaml, if every shard that can be
    read belongs to that experiment and, where shards are missing, neither the card nor the table of episodes
    lists another content. If pyarrow writes other bytes than the version that made the dataset, the manifest
    gets the new hashes. A damaged report.html is removed; `ibdata card` draws it again. A replacement that
    was interrupted is finished.

    Args:
        folder: The folder of the dataset.
        workers: How many processes to use; by default chosen by the work.
        allow_code: Allow custom policies, which run arbitrary Python code, to make shards again. They give
            the same bits only in the same environment.

    Returns:
        The paths of the files that were made again or removed.

    Raises:
        DatasetError: There is no dataset, or a file that was made again has another content.
    """
    refuse_url(folder)
    path = Path(folder)
    refuse_workers(workers)
    if not any(os.path.isdir(path / part) for part in ("meta", f"{manifest.NEW}/meta")):
        raise DatasetError(f"{path}: no dataset here: meta is missing")
    refuse_busy(path)
    output_folder.refuse_links(path)
    with writing_to(path):
        replacement.finish_interrupted(path)
        try:
            listed = manifest.read(path)
        except manifest.OtherVersionError:
            raise
        except DatasetError:
            return _rebuild(path, workers, allow_code)
        return _mend(path, listed, workers, allow_code)


def _mend(folder: Path, listed: Manifest, workers: int | None, allow_code: bool) -> list[str]:
    """Make again the listed files that are damaged."""
    entries = listed.entries()
    problems = list(check_files(folder, listed))
    damaged = [problem.path for problem in problems if problem.path in entries]
    if not damaged:
        refuse_other_plan(spec_in(folder, listed), listed)
        return []
    replacement.refuse_folders(folder, damaged)
    for problem in problems:  # before any file is written
        if problem.path not in entries:
            raise UsageError(f"{folder / problem.path}: {problem.message}, then repair")
        if manifest.WEIGHTS.fullmatch(problem.path):
            raise DatasetError(
                f"{folder / problem.path}: {problem.message}, but weights cannot be made again; copy the "
                f"file with the SHA-256 {entries[problem.path].sha256} there, then repair"
            )
    spec = spec_in(folder, listed)
    with in_one_folder(spec):
        _make_again(_placed(folder, spec), spec, listed, damaged, workers, allow_code)
    return damaged


def _placed(folder: Path, spec: DatasetSpec) -> Path:
    """The folder by its absolute path if there is custom code, which may change the current folder."""
    return folder.absolute() if customs(spec) else folder


def _make_again(
    folder: Path,
    spec: DatasetSpec,
    listed: Manifest,
    damaged: list[str],
    workers: int | None,
    allow_code: bool,
) -> None:
    """Make again the files with these paths."""
    entries = listed.entries()
    refuse_other_plan(spec, listed)
    paths = [shard.path for shard in listed.shards]
    wrong = [shard for shard in spec.shards if paths[shard.number] in damaged]
    lost = [path for path in damaged if path not in paths]
    if lost and listed.versions["ibdata"] != __version__:
        lost = list(metadata_files(spec, [], ""))  # so that one version writes all of them
    if wrong:
        require_consent(spec, folder, allow_code)
        for experiment in spec.experiments:
            warm_up(experiment)
        known_answer("episodes made again may differ")
    with replacement.staged(folder) as staged:
        made = _made_again(spec, wrong, staged, workers) if wrong else {}
        written = []
        for shard, one in zip(spec.shards, listed.shards, strict=True):
            w = made.get(shard.number)
            content = w.content if w else UNREAD
            if w is None and NEEDS_CONTENT & set(lost):
                content = stored_content(spec, shard, folder, one.path)
            if content is not UNREAD and content_of(content.digests) != one.content:
                found = "found other content when made again, expected the content that the manifest lists"
                raise DatasetError(f"{folder / one.path}: {found}; nothing was changed")
            if w:
                entries[one.path] = w.entry._replace(path=one.path)
            written.append(WrittenShard(shard, entries[one.path], content))
            check()
        table = read_episodes(folder, listed) if manifest.CARD in lost and EPISODES not in lost else None
        for path, make in metadata_files(spec, written, listed.content_root, table).items():
            if path in lost:
                entries[path] = write(staged, path, make())
        if manifest.REPORT in damaged:
            del entries[manifest.REPORT]  # only `ibdata card` can draw it
        _stage_manifest(folder, staged, listed, entries)
        _move(staged, folder, {w.entry.path: paths[number] for number, w in made.items()})


def _stage_manifest(folder: Path, staged: Path, listed: Manifest, entries: dict[str, FileEntry]) -> None:
    """Stage the manifest if files in `meta` or hashes change, together with the files that stay the same."""
    data = rewritten_manifest(listed, entries)
    staged_files = [path for path in entries if not path.startswith("data/") and (staged / path).exists()]
    if staged_files or data != (folder / manifest.PATH).read_bytes():
        rest = [path for path in entries if path.startswith("meta/") and path not in staged_files]
        replacement.keep(folder, staged, rest)
        write(staged, manifest.PATH, data)


def _move(staged: Path, folder: Path, files: dict[str, str]) -> None:
    """Move shards that were made again, and whose content was compared, to the places of damaged ones."""
    for source, path in files.items():
        (folder / "data").mkdir(exist_ok=True)
        (staged / source).replace(folder / path)
        sync_folder(folder / "data")
    if files:
        (staged / "data").rmdir()


def _rebuild(folder: Path, workers: int | None, allow_code: bool) -> list[str]:
    """Make the manifest again, and the shards that cannot be read."""
    spec = _spec_from_experiments(folder)
    require_consent(spec, folder, allow_code)
    with in_one_folder(spec):
        return _rebuilt(_placed(folder, spec), spec, workers)


def _rebuilt(folder: Path, spec: DatasetSpec, workers: int | None) -> list[str]:
    """Make again the manifest of a dataset of this spec, and the shards that cannot be read."""
    for experiment in spec.experiments:
        warm_up(experiment)
    whole: list[WrittenShard] = []
    wrong: list[Shard] = []
    digests: list[tuple[Shard, list[bytes]]] = []
    for shard in spec.shards:
        content = describe(spec, shard, simulated(spec, shard))
        digests.append((shard, content.digests))
        path = file_with(spec, shard, content, folder)
        if path is not None:
            entry = FileEntry(f"data/{path.name}", path.stat().st_size, file_sha256(path) or "")
            whole.append(WrittenShard(shard, entry, content))
        else:
            wrong.append(shard)
        check()
    damaged = [folder / path for path in strangers(folder, {w.entry.path for w in whole})]
    refuse_unproven(spec, folder, digests, len(whole), damaged)
    with replacement.staged(folder) as staged:
        made = _made_again(spec, wrong, staged, workers) if wrong else {}
        right = self_check.is_right(known_answer())
        finish(spec, [*whole, *made.values()], staged, right, provenance(customs(spec)))
        _move(staged, folder, {w.entry.path: w.entry.path for w in made.values()})
        for path in damaged:
            path.unlink()  # it was made again under another name
    return [manifest.PATH, *(made[shard.number].entry.path for shard in wrong)]


def _spec_from_experiments(folder: Path) -> DatasetSpec:
    """The spec of a dataset without a manifest, from meta/experiment*.yaml. Splits made later are lost."""
    several = sorted((folder / "meta").glob("experiment-*.yaml"))
    if not several and not os.path.lexists(folder / manifest.EXPERIMENT):
        raise DatasetError(
            f"{folder}: {manifest.PATH} and {manifest.EXPERIMENT} are lost, so nothing tells what to make "
            "again; restore one of the two"
        )
    experiments = tuple(load(path) for path in several or [folder / manifest.EXPERIMENT])
    return DatasetSpec(experiments[0].name, experiments)


def _made_again(
    spec: DatasetSpec, shards: list[Shard], staged: Path, workers: int | None
) -> dict[int, WrittenShard]:
    """Write the shards to `.next`; return them by number."""
    first = spec.experiments[0]
    write(staged, output_folder.EXPERIMENT, as_yaml(first))
    identity = output_folder.identity(first)
    made = {w.shard.number: w for w in local.run(spec, shards, staged, identity, workers)}
    output_folder.end(staged)
    return made
