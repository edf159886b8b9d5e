from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ibdata.cli._options import place_argument
from ibdata.cli._printing import MAX_LINES, Printed, contents, pairs, prints_result, table, within

if TYPE_CHECKING:
    from ibdata.dataset.reader import Dataset
    from ibdata.dataset.returns import Returns

SHOWN = ("policy", "setpoint", "episodes", "mean_return", "standard_error", "mean_reward", "reference_score")


@click.command("info")
@place_argument
@prints_result
def command(folder: Path | str) -> Printed:
    """Describe a dataset: its contents and the returns of its policies.

    \b
    ibdata info data/random
    """
    from ibdata.dataset.reader import Dataset
    from ibdata.measures.returns import MEANING, return_measures

    dataset = Dataset(folder)
    returns = dataset.returns()
    measures = return_measures(dataset.stored.episodes, dataset.stored.info)._asdict()
    lines = [_contents(dataset), "", _returns(returns)]
    for name, value in measures.items():
        if value is not None:
            lines.append(f"{name.replace('_', ' ')}: {value:.2f}, {MEANING[name]}")
    described = {
        "path": str(folder),
        "content_root": dataset.content_root,
        "info": dataset.info,
        "splits": dataset.splits,
        "returns": returns,
        "quality": measures,
    }
    return Printed(described, "\n".join(lines))


def _contents(dataset: Dataset) -> str:
    info = dataset.stored.info
    lines: list[tuple[str, object]] = [
        ("name", info.name),
        ("dynamics", "several" if info.dynamics is None else info.dynamics),
        *contents(dataset),
    ]
    for name, split in dataset.splits.items():
        lines.append((f"split {name}", within(split["rows"], split["episodes"])))
    for role in dict.fromkeys(column.role for column in info.columns):
        lines.append((role, ", ".join(info.names(role))))
    return pairs(lines)


def _returns(returns: Returns) -> str:
    """The first of the mean returns of each policy at each setpoint."""
    rows = [[*map(dict(line).get, SHOWN)] for line in returns["results"]]
    lines = [table([name.replace("_", " ") for name in SHOWN], rows[:MAX_LINES])]
    if len(rows) > MAX_LINES:
        lines.append(f"and {len(rows) - MAX_LINES:,} more; --json has all")
    if returns["scale"]:
        lines.append(f"reference score: {returns['scale']}")
    else:
        lines.append("no reference score: no references are stored for these dynamics, starts and steps")
    return "\n".join(lines)
