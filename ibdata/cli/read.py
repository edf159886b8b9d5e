"""Commands that look at datasets: ls, info, head, stats."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ibdata._numerics.naming import counted, rows_in_episodes
from ibdata.cli._options import PlaceType, place_argument, selects, split_option
from ibdata.cli._printing import MAX_LINES, Printable, Printed, contents, prints_result
from ibdata.dataset.tabular import Table, as_text, pairs, transposed
from ibdata.errors import notice

if TYPE_CHECKING:
    from ibdata.dataset.dataset import Dataset
    from ibdata.dataset.returns import Returns

MAX_ROWS = 1_000_000


@click.command("ls")
@click.argument("folder", metavar="[DIR|URL]", default=".", type=PlaceType())
@prints_result
def ls_command(folder: Path | str) -> Printable:
    """List the datasets in a folder or at a URL, and in the folders below it.

    The current folder is the default. By its manifest, a dataset is finished or damaged; ibdata validate
    checks all files. An unfinished one is shown with the hidden folder of its run: the same command goes on
    with it, and removing the folder drops it.

    \b
    ibdata ls
    ibdata ls data/siemens-offline
    ibdata ls s3://bucket/prefix
    """
    from ibdata.tools.listing import datasets_in

    return datasets_in(folder)


@click.command("info")
@place_argument
@prints_result
def info_command(folder: Path | str) -> Printed:
    """Describe a dataset: its contents and the returns of its policies.

    \b
    ibdata info data/random
    """
    from ibdata.dataset.dataset import Dataset
    from ibdata.dataset.quality import return_measures

    dataset = Dataset(folder)
    _name_lost_shards(dataset)
    returns = dataset.returns()
    measures = return_measures(dataset.stored.episodes, dataset.stored.info)._asdict()
    data = {
        "path": dataset.place,
        "content_root": dataset.content_root,
        "info": dataset.info,
        "splits": dataset.splits,
        "returns": returns,
        "quality": measures,
    }
    return Printed(data, "\n".join([_described(dataset), "", *_scored(returns, measures)]))


def _described(dataset: Dataset) -> str:
    """The contents of a dataset."""
    info = dataset.stored.info
    lines = [("name", info.name), ("dynamics", info.dynamics), *contents(dataset)]
    for name, split in dataset.splits.items():
        lines.append((f"split {name}", rows_in_episodes(split["rows"], split["episodes"])))
    for role in dict.fromkeys(column.role for column in info.columns):
        lines.append((role, ", ".join(info.names(role))))
    return pairs(lines)


def _scored(returns: Returns, measures: Mapping[str, float | None]) -> list[str]:
    """The first of the mean returns of each policy at each setpoint, and the measures of all returns."""
    from ibdata.dataset.quality import MEANING
    from ibdata.dataset.returns import results_table

    names, rows, *_ = results_table(returns)
    lines = [as_text(Table(names, rows[:MAX_LINES]))]
    if len(rows) > MAX_LINES:
        lines.append(f"and {len(rows) - MAX_LINES:,} more; --json has all")
    none = (
        "no score: reference returns are stored for siemens and paper, three starts and mostly 1000 steps; "
        "ibdata evaluate has scores for all"
    )
    lines.append(f"score: {returns['scale']}; one episode has none" if returns["scale"] else none)
    for name, value in measures.items():
        if value is not None:
            lines.append(f"{name.replace('_', ' ')}: {value:.2f} ({MEANING[name]})")
    return lines


@click.command("head")
@place_argument
@click.option(
    "--rows", "-n", type=click.IntRange(1, MAX_ROWS), default=5, show_default=True, help="Number of rows."
)
@click.option("--columns", metavar="A,B,…", help="Print only these columns.")
@split_option
@click.option(
    "--at", nargs=2, type=int, metavar="EPISODE STEP", help="Begin at this row; by default at the first."
)
@prints_result
def head_command(
    folder: Path | str,
    rows: int,
    columns: str | None,
    split: str | list[str] | None,
    at: tuple[int, int] | None,
) -> Printed:
    """Print the first rows of a dataset, or those from --at on, one column per line.

    \b
    ibdata head data/random -n 3 --columns step,act_velocity,reward
    ibdata head data/random --at 7 250
    """
    from ibdata.dataset.dataset import Dataset

    names = None if columns is None else [name.strip() for name in columns.split(",")]
    first = Dataset(folder).head(rows, names, split, at=at)
    return Printed({"rows": first.to_pylist()}, transposed(first.to_pydict()))


@click.command("stats")
@place_argument
@selects
@click.option(
    "--quality",
    "of_quality",
    is_flag=True,
    help="Print measures of the quality of the data instead. They read all rows.",
)
@prints_result
def stats_command(selection: Dataset, of_quality: bool) -> Printable:
    """Print mean, standard deviation, range and median of each column.

    \b
    ibdata stats data/random
    ibdata stats data/transfer --split target
    ibdata stats data/random --quality --returns -250000 inf
    """
    if of_quality:
        from ibdata.dataset.quality import quality

        measures = quality(selection)
        return Printed({"quality": measures.plain()}, measures)
    _name_lost_shards(selection)
    return selection.statistics()


def _name_lost_shards(rows: Dataset) -> None:
    """Say on stderr that rows are missing, which what is printed does not need."""
    if lost := rows.stored.lost_shards():
        shards = counted(len(rows.stored.manifest.shards), "Parquet file")
        notice(f"{rows.place}: {len(lost):,} of {shards} missing; see ibdata validate {rows.place}")
