"""Evidence, in a dataset that has lost its manifest, that its experiment is the one that it was made of."""

from __future__ import annotations

from pathlib import Path

from ibdata.dataset import manifest, parquet
from ibdata.dataset.episodes import PATH as EPISODES
from ibdata.errors import DatasetError, UsageError
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.generation.staging import is_ours
from ibdata.system.signals import check
from ibdata.validation.rows import check_shard
from ibdata.writing.card import listed_root
from ibdata.writing.finish import root_of
from ibdata.writing.stored import BATCH_ROWS
from ibdata.writing.summary import ShardSummary


def file_with(spec: DatasetSpec, shard: Shard, content: ShardSummary, folder: Path) -> Path | None:
    """The file that holds a shard's rows, and nothing else; None where none does."""
    for path in sorted((folder / "data").glob(f"{Path(shard.stem).name}-*.parquet")):
        try:
            found, _ = check_shard(spec, shard, folder, f"data/{path.name}")
        except (ValueError, IndexError):  # numbers of labels that do not exist
            continue
        if found is not None and found.digests == content.digests:
            return path
    return None


def refuse_unproven(
    spec: DatasetSpec, folder: Path, digests: list[tuple[Shard, list[bytes]]], whole: int, others: list[Path]
) -> None:
    """Raise DatasetError unless what is left of a dataset proves that its experiment is this one.

    Args:
        spec: The experiment, as meta/experiment.yaml tells it.
        folder: The dataset.
        digests: Those of the episodes of each shard, made again.
        whole: The number of shards whose files have that content.
        others: The other files in `data`.
    """
    for path in others:
        if not is_ours(path):
            raise UsageError(f"{path}: found something that ibdata did not write; move it away, then repair")
    readable = [path for path in others if _can_be_read(path)]
    root, expected = listed_root(folder / manifest.CARD), root_of(spec, digests)
    told = {
        manifest.CARD: None if root is None else root == expected,
        EPISODES: _same_digests(folder, digests),
    }
    agreed = False not in told.values() and (whole or True in told.values())
    if not readable and (whole == len(digests) or agreed):
        return
    words = {True: "that content", False: "other content", None: "no content that can be read"}
    raise DatasetError(
        f"{folder}: {manifest.PATH} is lost, and meta/experiment.yaml does not prove what it listed: found "
        f"{whole} of {whole + len(readable)} readable shards with the content of that experiment, "
        + ", ".join(f"{path} lists {words[same]}" for path, same in told.items())
        + (f", and {readable[0].name} has other content" if readable else "")
        + "; nothing was changed"
    )


def _can_be_read(path: Path) -> bool:
    try:
        for _ in parquet.batches(path.parent, path.name, None, BATCH_ROWS):
            check()
    except DatasetError:
        return False
    return True


def _same_digests(folder: Path, digests: list[tuple[Shard, list[bytes]]]) -> bool | None:
    """Whether the table of episodes lists these digests; None where it cannot be read."""
    try:
        found = parquet.read(folder, EPISODES, ["digest"])["digest"].to_pylist()
    except DatasetError:
        return None
    return bool(found == [digest for _, own in digests for digest in own])
