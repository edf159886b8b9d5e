"""What several commands share: arguments, options, and how results are printed."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from ibdata.errors import printable

MAX_LINES = 12  # of messages

allow_code_option = click.option(
    "--allow-code", is_flag=True, help="Let custom policies run: they are code; know whose it is."
)


class Place(click.Path):
    """A path, or a URL as it is."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        from ibdata.dataset.storage import is_url

        return value if is_url(value) else super().convert(value, param, ctx)


place_argument = click.argument("folder", metavar="DIR|URL", type=Place(path_type=Path))
folder_argument = click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
config_option = click.option(
    "--config",
    "config",
    required=True,
    metavar="C",
    help="A YAML file, a folder of them, or the name of a shipped one.",
)
set_option = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Override an option, e.g. --set episodes=100.",
)
seed_option = click.option("--seed", type=int, metavar="N", help="Override the seed.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")


def print_json(data: Mapping[str, Any]) -> None:
    """One JSON document with the version of its form."""
    click.echo(json.dumps({"version": 1, **data}, ensure_ascii=False, allow_nan=False))


def print_pairs(pairs: Sequence[tuple[str, Any]]) -> None:
    """Names and values, a line each."""
    width = max(len(name) for name, _ in pairs)
    for name, value in pairs:
        click.echo(f"{name.ljust(width)}  {value}")


def print_table(names: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Columns of text under their names, the first to the left and the others to the right."""
    widths = [max(map(len, column)) for column in zip(names, *rows, strict=True)]
    for row in (names, *rows):
        cells = [
            x.ljust(w) if i == 0 else x.rjust(w) for i, (x, w) in enumerate(zip(row, widths, strict=True))
        ]
        click.echo("  ".join(cells))


def problems_json(problems: Sequence[Any]) -> list[dict[str, Any]]:
    """Problems as JSON, each with the file, row and rule."""
    return [problem._asdict() for problem in problems]


def report_problems(problems: Sequence[Any], fine: str, quiet: bool) -> None:
    """Say that all is fine, or what is not, on stderr, and end with exit code 3."""
    if not problems:
        if not quiet:
            click.echo(fine)
        return
    for problem in problems[:MAX_LINES]:
        click.echo(printable(str(problem)), err=True)
    if len(problems) > MAX_LINES:
        click.echo(f"and {len(problems) - MAX_LINES} more", err=True)
    raise SystemExit(3)


def size(count: float) -> str:
    """Bytes for people.

    >>> size(791701)
    '0.8 MB'
    """
    for unit, scale in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= scale / 10:
            return f"{count / scale:.1f} {unit}"
    return f"{count:.0f} bytes"
