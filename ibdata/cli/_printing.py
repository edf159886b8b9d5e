"""Printing. A command returns its result, which is printed as text or, with --json, as one JSON document."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import click

from ibdata._numerics.naming import counted, size
from ibdata.errors import notice, printable, public_url

if TYPE_CHECKING:
    from ibdata.dataset.dataset import Dataset

MAX_LINES = 12  # of a list of problems or results


class Printable(Protocol):
    """What a command returns, such as a result of the library: its `repr` or `plain` (--json) is printed."""

    def plain(self) -> Mapping[str, Any]: ...


class Printed(NamedTuple):
    """A result that is no more than what is printed."""

    data: Mapping[str, Any]  # with --json
    text: object  # without it
    problems: Sequence[object] = ()  # lines for stderr; if there are any, the exit code is 3

    def plain(self) -> Mapping[str, Any]:
        return self.data

    def __repr__(self) -> str:
        return str(self.text)


def prints_result(function: Callable[..., Printable]) -> Callable[..., None]:
    """Give a command the option --json, and print what it returns."""

    @functools.wraps(function)
    def command(*args: Any, as_json: bool, **options: Any) -> None:
        result = function(*args, **options)
        if as_json:
            print_json({"version": 1, **result.plain()})
        elif text := repr(result):
            say(text)
        problems = result.problems if isinstance(result, Printed) else ()
        for line in shortened(problems):
            notice(line, "")
        click.get_current_context().exit(3 if problems else 0)

    return click.option("--json", "as_json", is_flag=True, help="Print the result as one JSON document.")(
        command
    )


def say(text: str) -> None:
    """Print text of one line or several.

    It may hold texts of datasets, experiments and policies, so control characters are escaped, and
    credentials in URLs are hidden.
    """
    for line in text.removesuffix("\n").split("\n"):
        click.echo(printable(public_url(line)))


def print_json(data: Mapping[str, Any], indent: int | None = None) -> None:
    """Print data as one JSON document, in ASCII."""
    click.echo(json.dumps(_plain(data), allow_nan=False, indent=indent))


def _plain(data: Any) -> Any:
    """Data without credentials, and with null in place of NaN and infinities, which JSON does not have."""
    if isinstance(data, str):
        return public_url(data)
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    if isinstance(data, Mapping):
        return {key: _plain(value) for key, value in data.items()}
    return [_plain(value) for value in data] if isinstance(data, list | tuple) else data


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


def contents(dataset: Dataset) -> list[tuple[str, object]]:
    """Rows, files and content root of a dataset, as text."""
    counts = dataset.stored.info.counts
    lengths = [counts.steps or 0]
    if counts.steps is None:
        lengths = dataset.stored.episodes["length"].unique().to_pylist()
    steps = " or ".join([*(f"{n:,}" for n in lengths[:-1]), counted(lengths[-1], "step")])
    return [
        ("rows", f"{counts.rows:,} in {counted(counts.episodes, 'episode')} of {steps}"),
        ("files", f"{counts.shards:,} data/*.parquet, {size(dataset.stored.manifest.data_bytes)}"),
        ("content root", dataset.content_root),
    ]
