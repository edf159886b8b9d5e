"""Reproducing a dataset from its own experiment, in memory, and comparing every episode."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.digest import episode_digests
from ibdata.dataset.episodes import read_episodes
from ibdata.dataset.models import Manifest
from ibdata.errors import UsageError
from ibdata.experiment.code_record import provenance
from ibdata.experiment.custom_code import consented_spec, customs
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fresh_modules import in_one_folder
from ibdata.experiment.plan import Shard
from ibdata.generation.warm_up import known_answer, warm_up
from ibdata.system.storage import refuse_url, storage
from ibdata.validation.files import changed_files
from ibdata.validation.rules import Problem
from ibdata.writing.arrow import digest_runs
from ibdata.writing.finish import root_of
from ibdata.writing.planned import refuse_other_plan
from ibdata.writing.summary import simulated


def reproduce(
    folder: str | os.PathLike[str], episodes: int | str | None = None, allow_code: bool = False
) -> tuple[int, list[Problem]]:
    """Make episodes again in memory and compare them with the digests that the dataset lists.

    The files that hold these episodes must have the SHA-256 that the manifest lists, and the content root
    must be that of the experiment's cells and the listed digests.

    Args:
        folder: The folder of the dataset; nothing is written to it.
        episodes: A number of episodes, which are spread evenly, or a range such as "500-600"; None means all.
        allow_code: Allow custom policies, which run arbitrary Python code. They give the same bits only in
            the same environment.

    Returns:
        How many episodes were made again, and a problem for each that differs, and for each file that is
        missing or changed.

    Raises:
        DatasetError: There is no finished dataset, or it is of another data version.
        UsageError: The dataset has no such episodes, or has custom policies that are not allowed.
    """
    refuse_url(folder)
    path = Path(folder)
    listed = manifest.read(path)
    spec = consented_spec(path, listed, allow_code)
    refuse_other_plan(spec, listed)
    table = read_episodes(path, listed)
    digests, shards, rows = (table[name].to_pylist() for name in ("digest", "shard", "row_start"))
    count, clipped, problems = 0, 0, list(_root(spec, listed, digests))
    asked = list(_parts(spec, None if episodes is None else str(episodes), len(digests)))
    problems += changed_files(storage(path), listed, {listed.shards[part.number].path for part in asked})
    with in_one_folder(spec):
        for experiment in spec.experiments:
            warm_up(experiment)
        provenance(customs(spec))  # refuses bytecode of other code, which would run
        known_answer("episodes made again may differ")
        for part, floats in (made for run in asked for made in simulated(spec, run)):
            experiment = spec.of_shard(part)
            lengths = [experiment.steps] * (part.stop - part.first)
            found = episode_digests(digest_runs(experiment, part, floats), lengths)
            count, clipped = count + len(found), clipped + floats.clipped
            for episode, digest in enumerate(found, part.first + part.offset):
                if digest != digests[episode]:
                    message = f"episode {episode}: found other content when made again"
                    shard = listed.shards[shards[episode]].path
                    problems.append(Problem(shard, rows[episode], "reproduce", message))
    if episodes is None and clipped != listed.clipped_actions:
        message = f"clipped_actions: found {listed.clipped_actions}, expected {clipped}"
        problems.append(Problem(manifest.PATH, None, "reproduce", message))
    return count, problems


def _root(spec: DatasetSpec, listed: Manifest, digests: list[bytes]) -> Iterator[Problem]:
    own = ((s, digests[s.first + s.offset : s.stop + s.offset]) for s in spec.shards)
    root = root_of(spec, own)
    if root != listed.content_root:
        message = f"content root: found {listed.content_root}, expected {root}"
        yield Problem(manifest.PATH, None, "reproduce", message)


def _parts(spec: DatasetSpec, episodes: str | None, total: int) -> Iterator[Shard]:
    if episodes is None:
        yield from spec.shards
        return
    first, dash, last = episodes.partition("-")
    if not re.fullmatch("[0-9]{1,18}(-[0-9]{1,18})?", episodes):
        found = episodes if len(episodes) < 40 else f"{episodes[:40]}…"
        raise UsageError(f"--episodes: found {found!r}, expected a number or a range such as 500-600")
    if not dash:
        number = min(total, int(first))
        ranges = [(i * total // number, i * total // number + 1) for i in range(number)]
    else:
        ranges = [(int(first), int(last) + 1)]
    if not ranges or not ranges[0][0] < ranges[-1][1] <= total:
        raise UsageError(f"--episodes: found {episodes!r}, expected a number or a range within 0-{total - 1}")
    for shard in spec.shards:
        for low, high in ranges:
            start, stop = max(low - shard.offset, shard.first), min(high - shard.offset, shard.stop)
            if start < stop:
                yield shard._replace(first=start, stop=stop)
