"""Reproducing a dataset from its own experiment, in memory, and comparing every episode."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator

from ibdata.arguments import public
from ibdata.dataset import manifest
from ibdata.dataset.digest import episode_digests
from ibdata.dataset.models import Manifest
from ibdata.dataset.stored import Stored
from ibdata.errors import UsageError
from ibdata.experiment.code import changed_here, consented_spec, names_of
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.generation.process import process_for
from ibdata.generation.record import known_answer, warm_up
from ibdata.system.storage import existing, local
from ibdata.validation.rules import Problem
from ibdata.validation.validate import changed_files
from ibdata.writing.columns import simulated
from ibdata.writing.finish import refuse_other_plan, root_of


@public
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
    stored = Stored.open(local(existing(folder)))
    listed = stored.manifest
    spec = consented_spec(stored, allow_code)
    refuse_other_plan(spec, listed)
    digests, shards, rows = (stored.episodes[name].to_pylist() for name in ("digest", "shard", "row_start"))
    problems = list(_root(spec, listed, digests))
    asked = list(_parts(spec, None if episodes is None else str(episodes), len(digests)))
    problems += changed_files(stored, {listed.shards[part.number].path for part in asked})
    names = changed_here(spec, listed.code)
    if names:
        found = f"ibdata: {stored.name}: was made with other code than is here, in {names_of(names)}"
        print(found, file=sys.stderr, flush=True)
    with process_for(spec) as process:
        clipped, differing = process.call(_made_again, asked, digests)
    for episode in differing:
        message = f"episode {episode}: found other content when made again"
        problems.append(Problem(listed.shards[shards[episode]].path, rows[episode], "reproduce", message))
    if episodes is None and clipped != listed.clipped_actions:
        message = f"clipped_actions: found {listed.clipped_actions}, expected {clipped}"
        problems.append(Problem(manifest.PATH, None, "reproduce", message))
    if problems:  # begin with what may have led to them
        message = "found other code than the dataset was made with"
        problems[:0] = [Problem(name, None, "reproduce", message) for name in names]
    return sum(part.stop - part.first for part in asked), problems


def _made_again(spec: DatasetSpec, asked: list[Shard], digests: list[bytes]) -> tuple[int, list[int]]:
    """Make episodes again; return the number of clipped actions, and the episodes with other digests."""
    clipped, differing = 0, []
    for experiment in spec.experiments:
        warm_up(experiment)
    known_answer("episodes made again may differ")
    for piece in (piece for shard in asked for piece in simulated(spec, shard)):
        shard = piece.episodes
        lengths = [piece.experiment.steps] * (shard.stop - shard.first)
        clipped += piece.floats.clipped
        again = enumerate(episode_digests(piece.digest_columns(), lengths), shard.first + shard.offset)
        differing += [episode for episode, digest in again if digest != digests[episode]]
    return clipped, differing


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
