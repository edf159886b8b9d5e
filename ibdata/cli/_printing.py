"""Printing. A command returns its result, which is printed as text or, with --json, as one JSON document."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import click

from ibdata.dataset.tabular import Table, as_text
from ibdata.errors import hidden, notice, printable
from ibdata.numerics.naming import counted

if TYPE_CHECKING:
    from ibdata.dataset.reader import Dataset

MAX_LINES = 12  # of a list of problems or results


class Result(Protocol):
    """What a command returns: its `repr` is printed, or `plain` with --json."""

    def plain(self) -> Mapping[str, Any]: ...


class Printed(NamedTuple):
    """A result of a command that is no result of the library.

    Attributes:
        data: What --json prints.
        text: What is printed without it.
        problems: Lines for stderr.
        exit_code: The exit code of the command.
    """

    data: Mapping[str, Any]
    text: str = ""
    problems: Sequence[object] = ()
    exit_code: int = 0

    def plain(self) -> Mapping[str, Any]:
        return self.data

    def __repr__(self) -> str:
        return self.text


def prints_result(function: Callable[..., Result]) -> Callable[..., None]:
    """Give a command the option --json, and print what it returns."""

    @functools.wraps(function)
    def command(*args: Any, as_json: bool, **options: Any) -> None:
        result = function(*args, **options)
        if as_json:
            print_json({"version": 1, **result.plain()})
        elif text := repr(result):
            say(text)
        if isinstance(result, Printed):
            for problem in shortened(result.problems):
                notice(problem, "")
            click.get_current_context().exit(result.exit_code)

    return click.option("--json", "as_json", is_flag=True, help="Print the result as one JSON document.")(
        command
    )


def say(text: str) -> None:
    """Print text of one line or several.

    It may hold texts of datasets, experiments and policies, so control characters are escaped, and
    credentials in URLs are hidden.
    """
    for line in text.removesuffix("\n").split("\n"):
        click.echo(printable(hidden(line)))


def print_json(data: Mapping[str, Any], indent: int | None = None) -> None:
    """Print data as one JSON document, in ASCII."""
    click.echo(json.dumps(_plain(data), allow_nan=False, indent=indent))


def _plain(data: Any) -> Any:
    """Data without credentials, and with null in place of NaN and infinities, which JSON does not have."""
    if isinstance(data, str):
        return hidden(data)
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    if isinstance(data, Mapping):
        return {key: _plain(value) for key, value in data.items()}
    return [_plain(value) for value in data] if isinstance(data, list | tuple) else data


def problems_found(problems: Sequence[Any], data: Mapping[str, Any], fine: str) -> Printed:
    """The result of a check: `fine`, or the problems on stderr and the exit code 3."""
    listed = {**data, "problems": [problem._asdict() for problem in problems]}
    return Printed(listed, "", problems, 3) if problems else Printed(listed, fine)


def made(dataset: Dataset, seconds: float | None = None) -> Printed:
    """A dataset that a command made, perhaps with the seconds that it took."""
    data, rows = described(dataset), [("dataset", dataset.place), *contents(dataset)]
    if seconds is not None:
        data["seconds"] = seconds
        rows.append(("seconds", f"{seconds:.1f}"))
    return Printed(data, pairs(rows))


def described(dataset: Dataset) -> dict[str, Any]:
    """The place, counts and content root of a dataset."""
    return {"out": dataset.place, **dataset.info["counts"], "content_root": dataset.content_root}


def contents(dataset: Dataset) -> list[tuple[str, str]]:
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


def shortened(lines: Sequence[object]) -> list[str]:
    """The first lines, and how many more there are.

    >>> shortened(["a"] * 14)[-2:]
    ['a', 'and 2 more']
    """
    more = len(lines) - MAX_LINES
    return [*map(str, lines[:MAX_LINES]), *([f"and {more:,} more"] if more > 0 else [])]


def lines(texts: Iterable[object]) -> str:
    """One line for each text, whatever characters it holds."""
    return "\n".join(printable(str(text)) for text in texts)


def pairs(rows: Sequence[tuple[str, object]]) -> str:
    """Names and values, a pair a line.

    >>> print(pairs([("rows", 5), ("name", "a")]))
    rows  5
    name  a
    """
    width = max(len(name) for name, _ in rows)
    return lines(f"{name.ljust(width)}  {value}" for name, value in rows)


def table(names: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Columns under their names."""
    return as_text(Table(names, rows))


def within(rows: int, episodes: int) -> str:
    """Rows and episodes.

    >>> within(10_000, 1)
    '10,000 rows in 1 episode'
    """
    return f"{counted(rows, 'row')} in {counted(episodes, 'episode')}"


def size(count: float) -> str:
    """Format a number of bytes.

    >>> size(791701)
    '0.8 MB'
    """
    for unit, scale in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= scale / 10:
            return f"{count / scale:.1f} {unit}"
    return f"{count:.0f} bytes"
