"""Reproducing a dataset from its own experiment, in memory, and comparing every episode."""

from __future__ import annotations

import os
from collections.abc import Iterator

from ibdata._numerics.arguments import public
from ibdata._system.storage import existing, local
from ibdata.dataset import manifest
from ibdata.dataset.stored import Stored
from ibdata.errors import UsageError, notice, parameter
from ibdata.generation.finish import refuse_other_plan
from ibdata.generation.pieces import simulated
from ibdata.generation.process import process_for
from ibdata.generation.record import warm_up_again
from ibdata.plan.code_record import changed_here, names_of
from ibdata.plan.consent import consented_spec
from ibdata.plan.dataset_spec import DatasetSpec, Shard
from ibdata.tools.checks import root_problems
from ibdata.tools.rules import Problem
from ibdata.tools.validate import changed_files


@public
def reproduce(
    folder: str | os.PathLike[str], episodes: int | None = None, allow_code: bool = False
) -> tuple[int, list[Problem]]:
    """Make episodes again in memory and compare them with the digests that the dataset lists.

    The files that hold these episodes must have the SHA-256 that the manifest lists, and the content root
    must be that of the experiment's cells and the listed digests.

    Args:
        folder: The folder of the dataset; nothing is written to it.
        episodes: A number of episodes, which are spread evenly; None means all.
        allow_code: Allow custom policies, which run arbitrary Python code. They give the same bits only in
            the same environment.

    Returns:
        How many episodes were made again, and a problem for each that differs, and for each file that is
        missing or changed.

    Raises:
        DatasetError: There is no finished dataset, or it is of another data version.
        UsageError: The number is below 1, or the dataset has custom policies that are not allowed.
    """
    stored = Stored.open(local(existing(folder)))
    listed = stored.manifest
    spec = consented_spec(stored, allow_code)
    refuse_other_plan(spec, listed)
    digests, shards, rows = (stored.episodes[name].to_pylist() for name in ("digest", "shard", "row_start"))
    digests_of_shards = ((s, digests[s.first + s.offset : s.stop + s.offset]) for s in spec.shards)
    problems = list(root_problems(spec, listed, digests_of_shards))
    asked = list(_parts(spec, episodes, len(digests)))
    problems += changed_files(stored, {listed.shards[part.number].path for part in asked})
    names = changed_here(spec, listed.code)
    if names:
        notice(f"{stored.name}: was made with other code than is here, in {names_of(names)}")
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
    warm_up_again(spec)
    for piece in (piece for shard in asked for piece in simulated(spec, shard)):
        shard = piece.episodes
        clipped += piece.floats.clipped
        again = enumerate(piece.digests(), shard.first + shard.offset)
        differing += [episode for episode, digest in again if digest != digests[episode]]
    return clipped, differing


def _parts(spec: DatasetSpec, count: int | None, total: int) -> Iterator[Shard]:
    """All shards, or a part for each of so many episodes, spread evenly over the `total` ones."""
    if count is None:
        yield from spec.shards
        return
    if count < 1:
        raise UsageError(f"{parameter('episodes')}: found {count}, expected a whole number of at least 1")
    count = min(count, total)
    episodes = [i * total // count for i in range(count)]
    for shard in spec.shards:
        for episode in episodes:
            first = episode - shard.offset
            if shard.first <= first < shard.stop:
                yield shard._replace(first=first, stop=first + 1)
