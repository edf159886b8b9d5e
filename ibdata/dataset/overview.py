"""A dataset and its splits as tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ibdata.dataset.tabular import Table, Tabular, as_html

if TYPE_CHECKING:
    from ibdata.dataset.contents import Contents


class Splits(Tabular, dict[str, dict[str, Any]]):
    """The splits of a dataset by name: a dict that shows as a table."""

    def tables(self) -> list[Table]:
        """The splits, a row each; those without files of their own are labels of episodes."""
        rows = [
            (name, split["episodes"], split["rows"], "labels" if split["files"] is None else "whole files")
            for name, split in self.items()
        ]
        return [Table(("split", "episodes", "rows", "kind"), rows, () if rows else ["no splits"])]


def overview(dataset: Contents) -> str:
    """A dataset and its splits as HTML."""
    info, episodes = dataset.info_model, dataset.episode_table
    row = {
        "dataset": info.name,
        "rows": info.counts.rows,
        "episodes": info.counts.episodes,
        "policies": episodes["policy"].unique().to_pylist(),
        "setpoints": episodes["setpoint"].unique().to_pylist(),
        "content root": f"{dataset.content_root[:12]}…",
        "in": dataset.place,
    }
    return as_html([Table(list(row), [list(row.values())]), *dataset.splits.tables()])
