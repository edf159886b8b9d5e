"""ibdata info."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ibdata.cli._shared import (
    MAX_LINES,
    json_option,
    place_argument,
    print_json,
    print_pairs,
    print_table,
    say,
    size,
    within,
)
from ibdata.numerics.naming import counted, exact

if TYPE_CHECKING:
    from ibdata.dataset.reader import Dataset
    from ibdata.dataset.returns import Returns


@click.command("info")
@place_argument
@json_option
def command(folder: Path | str, as_json: bool) -> None:
    """Describe a dataset: its contents and the returns of its policies.

    \b
    ibdata info data/random
    """
    from ibdata.dataset.reader import Dataset
    from ibdata.measures.returns import MEANING, return_measures

    dataset = Dataset(folder)
    info, returns = dataset.info_model, dataset.returns()
    measures = return_measures(dataset.episode_table, info)
    counts = info.counts
    if as_json:
        root = dataset.content_root
        described = {
            "path": str(folder),
            "content_root": root,
            "info": dataset.info,
            "splits": dataset.splits,
        }
        print_json({**described, "returns": returns, "quality": measures._asdict()})
        return
    pairs = [
        ("name", info.name),
        ("dynamics", "several" if info.dynamics is None else info.dynamics),
        ("rows", f"{counts.rows:,} in {counted(counts.episodes, 'episode')} of {_steps(dataset)}"),
        ("files", f"{counts.shards:,} Parquet, {size(dataset.manifest_model.data_bytes)}"),
        ("content root", dataset.content_root),
    ]
    for name, split in dataset.splits.items():
        pairs.append((f"split {name}", within(split["rows"], split["episodes"])))
    for role in dict.fromkeys(column.role for column in info.columns):
        pairs.append((role, ", ".join(info.names(role))))
    print_pairs(pairs)
    say()
    _print_returns(returns)
    for name, value in measures._asdict().items():
        if value is not None:
            say(f"{name.replace('_', ' ')}: {value:.2f}, {MEANING[name]}")


def _steps(dataset: Dataset) -> str:
    """The steps per episode; several numbers if the episodes of a merged dataset differ in length."""
    steps = dataset.info_model.counts.steps
    lengths = dataset.episodes["length"].unique() if steps is None else [steps]
    return " or ".join([*(f"{n:,}" for n in lengths[:-1]), counted(lengths[-1], "step")])


def _print_returns(returns: Returns) -> None:
    """Print the mean returns of each policy at each setpoint, but only the first lines."""
    rows = [
        (
            r["policy"],
            exact(r["setpoint"]),
            f"{r['episodes']:,}",
            f"{r['mean_return']:,.0f}",
            "-" if r["standard_error"] is None else f"{r['standard_error']:,.0f}",
            f"{r['mean_reward']:.2f}",
            "-" if r["score"] is None else f"{r['score']:.1f}",
        )
        for r in returns["results"]
    ]
    names = ("policy", "setpoint", "episodes", "return", "± s.e.", "reward/step", "score")
    print_table(names, rows[:MAX_LINES])
    if len(rows) > MAX_LINES:
        say(f"and {len(rows) - MAX_LINES:,} more; --json has all")
    if returns["scale"]:
        say(f"score: {returns['scale']}")
