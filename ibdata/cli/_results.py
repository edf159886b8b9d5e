"""What commands say of the datasets that they make, describe and split."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from ibdata.cli._printing import MAX_LINES
from ibdata.dataset.tabular import Table, as_text, pairs
from ibdata.numerics.naming import counted, size, within

if TYPE_CHECKING:
    from ibdata.dataset.dataset import Dataset

SHOWN = ("policy", "setpoint", "episodes", "mean_return", "standard_error", "mean_reward", "reference_score")


def _counts(dataset: Dataset) -> dict[str, Any]:
    """The place, counts and content root of a dataset."""
    return {"out": dataset.place, **dataset.info["counts"], "content_root": dataset.content_root}


def _contents(dataset: Dataset) -> list[tuple[str, str]]:
    """Rows, files and content root of a dataset, as text."""
    counts = dataset.stored.info.counts
    lengths = (
        dataset.stored.episodes["length"].unique().to_pylist() if counts.steps is None else [counts.steps]
    )
    steps = " or ".join([*(f"{n:,}" for n in lengths[:-1]), counted(lengths[-1], "step")])
    return [
        ("rows", f"{counts.rows:,} in {counted(counts.episodes, 'episode')} of {steps}"),
        ("files", f"{counts.shards:,} Parquet, {size(dataset.stored.manifest.data_bytes)}"),
        ("content root", dataset.content_root),
    ]


class Made:
    """A dataset that a command made, perhaps with the seconds that it took."""

    def __init__(self, dataset: Dataset, seconds: float | None = None) -> None:
        self.dataset, self.seconds = dataset, seconds

    def plain(self) -> dict[str, Any]:
        seconds = {} if self.seconds is None else {"seconds": self.seconds}
        return _counts(self.dataset) | seconds

    def __repr__(self) -> str:
        rows = [("dataset", self.dataset.place), *_contents(self.dataset)]
        if self.seconds is not None:
            rows.append(("seconds", f"{self.seconds:.1f}"))
        return pairs(rows)


class Suite:
    """The datasets of a folder of experiments, and the seconds that they took."""

    def __init__(self, datasets: Mapping[str, Dataset], seconds: float) -> None:
        self.datasets, self.seconds = datasets, seconds
        self.folder = str(Path(next(iter(datasets.values())).place).parent)
        self.rows = sum(map(len, datasets.values()))

    def plain(self) -> dict[str, Any]:
        datasets = [{"name": name, **_counts(dataset)} for name, dataset in self.datasets.items()]
        return {"out": self.folder, "datasets": datasets, "rows": self.rows, "seconds": self.seconds}

    def __repr__(self) -> str:
        datasets = self.datasets.values()
        lines = [f"{d.place}: {counted(len(d), 'row')}, content root {d.content_root}" for d in datasets]
        total = [
            ("datasets", f"{len(datasets)} in {self.folder}"),
            ("rows", f"{self.rows:,}"),
            ("bytes", size(sum(dataset.stored.manifest.data_bytes for dataset in datasets))),
            ("time", f"{self.seconds:.1f} s"),
        ]
        return "\n".join([*lines, "", pairs(total)])


class Description:
    """The contents of a dataset and the returns of its policies."""

    def __init__(self, dataset: Dataset) -> None:
        from ibdata.measures.returns import return_measures

        self.dataset, self.returns = dataset, dataset.returns()
        self.measures = return_measures(dataset.stored.episodes, dataset.stored.info)._asdict()

    def plain(self) -> dict[str, Any]:
        return {
            "path": self.dataset.place,
            "content_root": self.dataset.content_root,
            "info": self.dataset.info,
            "splits": self.dataset.splits,
            "returns": self.returns,
            "quality": self.measures,
        }

    def __repr__(self) -> str:
        from ibdata.measures.returns import MEANING

        info = self.dataset.stored.info
        rows: list[tuple[str, object]] = [
            ("name", info.name),
            ("dynamics", "several" if info.dynamics is None else info.dynamics),
            *_contents(self.dataset),
        ]
        for name, split in self.dataset.splits.items():
            rows.append((f"split {name}", within(split["rows"], split["episodes"])))
        for role in dict.fromkeys(column.role for column in info.columns):
            rows.append((role, ", ".join(info.names(role))))
        measures = [
            f"{name.replace('_', ' ')}: {value:.2f}, {MEANING[name]}"
            for name, value in self.measures.items()
            if value is not None
        ]
        return "\n".join([pairs(rows), "", *self._returns(), *measures])

    def _returns(self) -> list[str]:
        """The first of the mean returns of each policy at each setpoint."""
        rows = [[*map(dict(line).get, SHOWN)] for line in self.returns["results"]]
        lines = [as_text(Table([name.replace("_", " ") for name in SHOWN], rows[:MAX_LINES]))]
        if len(rows) > MAX_LINES:
            lines.append(f"and {len(rows) - MAX_LINES:,} more; --json has all")
        if self.returns["scale"]:
            return [*lines, f"reference score: {self.returns['scale']}"]
        return [*lines, "no reference score: no references are stored for these dynamics, starts and steps"]


class Splits:
    """The splits of a dataset, and those that it had before a command changed them."""

    def __init__(self, dataset: Dataset, before: Mapping[str, Any] = MappingProxyType({})) -> None:
        self.dataset, now = dataset, dataset.stored.splits
        changes = {
            "replaced": [name for name in before if name in now and before[name] != now[name]],
            "removed": [name for name in before if name not in now],
        }
        self.taken_away = {change: names for change, names in changes.items() if names}

    def plain(self) -> dict[str, Any]:
        return {
            "path": self.dataset.place,
            "splits": self.dataset.splits,
            "content_root": self.dataset.content_root,
            "taken_away": self.taken_away,
        }

    def __repr__(self) -> str:
        splits = self.dataset.splits
        lines = [f"removed the split {name}" for name in self.taken_away.get("removed", [])]
        for name in self.taken_away.get("replaced", []):
            lines.append(f"replaced the split {name}; --prefix or --name keeps both")
        width = max(map(len, splits), default=0)
        for name, split in splits.items():
            kind = "whole files" if split["declared"] else "labels"
            lines.append(f"{name.ljust(width)}  {within(split['rows'], split['episodes'])} ({kind})")
        return "\n".join(lines if splits else [*lines, f"{self.dataset.place}: no splits"])
