"""What commands print of a dataset that they made."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ibdata.cli._printing import Printed, pairs, size
from ibdata.numerics.naming import counted

if TYPE_CHECKING:
    from ibdata.dataset.reader import Dataset


def described(dataset: Dataset) -> dict[str, Any]:
    """The place, counts and content root of a dataset."""
    return {"out": dataset.place, **dataset.info["counts"], "content_root": dataset.content_root}


def contents(dataset: Dataset) -> list[tuple[str, object]]:
    """Rows, files and content root of a dataset, as text."""
    counts = dataset.info_model.counts
    lengths = dataset.episode_table["length"].unique().to_pylist() if counts.steps is None else [counts.steps]
    steps = " or ".join([*(f"{n:,}" for n in lengths[:-1]), counted(lengths[-1], "step")])
    data_bytes = size(dataset.manifest_model.data_bytes)
    return [
        ("rows", f"{counts.rows:,} in {counted(counts.episodes, 'episode')} of {steps}"),
        ("files", f"{counts.shards:,} Parquet, {data_bytes}"),
        ("content root", dataset.content_root),
    ]


def made(dataset: Dataset, seconds: float | None = None) -> Printed:
    """A dataset that a command made, perhaps with the seconds that it took."""
    took = {} if seconds is None else {"seconds": seconds}
    lines = [("dataset", dataset.place), *contents(dataset), *((n, f"{s:.1f}") for n, s in took.items())]
    return Printed({**described(dataset), **took}, pairs(lines))
