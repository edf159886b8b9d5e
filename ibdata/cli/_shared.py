"""Arguments, options and printing functions that several commands share."""

from __future__ import annotations

import ast
import codecs
import json
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, TextIO

import click

from ibdata.errors import hidden, printable, suggestion
from ibdata.numerics.naming import counted

MAX_LINES = 12  # of a list of problems or results
NOT_ASCII = re.compile(r"[^\n\x20-\x7e]")
UNIT = re.compile("....")  # of UTF-16, in hex

allow_code_option = click.option(
    "--allow-code",
    is_flag=True,
    help="Allow custom policies, which run arbitrary Python code. Use only with code you trust. --debug "
    "shows the traceback of an error in it.",
)


class Place(click.Path):
    """A path; a URL is kept as a string."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        from ibdata.system.storage import is_url

        return value if is_url(value) else super().convert(value, param, ctx)


class LocalPath(click.Path):
    """A path; a URL is refused."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        from ibdata.system.storage import refuse_url

        refuse_url(value)
        return super().convert(value, param, ctx)


class Listing(click.Command):
    """A command whose help ends with a list of names and descriptions."""

    def __init__(
        self, *args: Any, title: str, listed: Callable[[], list[tuple[str, str]]], **options: Any
    ) -> None:
        super().__init__(*args, **options)
        self._title, self._listed = title, listed

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section(self._title):
            formatter.write_dl(self._listed())


class Suggesting(click.Group):
    """A group of commands that suggests a similar command in place of an unknown one."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Without arguments, print the help on stderr; the exit code is 2."""
        if not args and not ctx.resilient_parsing:
            for line in ctx.get_help().split("\n"):
                say(line, err=True)
            ctx.exit(2)
        return super().parse_args(ctx, args)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            known = suggestion(args[0], self.list_commands(ctx))
            raise click.UsageError(f"No such command {args[0]!r}{known or '.'}", ctx=error.ctx) from None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write each command with its whole summary, which may take several lines."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, self.summary(ctx, name)) for name in self.list_commands(ctx)])

    def summary(self, ctx: click.Context, name: str) -> str:
        """The first sentence of a command's help."""
        command = self.get_command(ctx, name)
        return command.get_short_help_str(limit=1000) if command else ""


def summaries(package: str, names: Iterable[str]) -> list[tuple[str, str]]:
    """The first paragraph of the docstring of each module, read without importing the module."""
    (folder,) = import_module(package).__path__
    docstrings = ((n, ast.get_docstring(ast.parse(Path(folder, f"{n}.py").read_bytes()))) for n in names)
    return [(name, " ".join((text or "").partition("\n\n")[0].split())) for name, text in docstrings]


place_argument = click.argument("folder", metavar="DIR|URL", type=Place(path_type=Path))
folder_argument = click.argument("folder", metavar="DIR", type=LocalPath())
set_option = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Override an option of the experiment, e.g. --set episodes=100.",
)
seed_option = click.option("--seed", type=int, metavar="N", help="Override the seed of the experiment.")
quiet_option = click.option("--quiet", "-q", is_flag=True, help="Show no progress bar.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as one JSON document.")


def say(line: object = "", err: bool = False) -> None:
    """Print a line. All output of commands goes through here or `print_json`.

    The line may hold texts of datasets, experiments and policies. Control characters, and characters that the
    stream cannot encode, are escaped; credentials in URLs are hidden.
    """
    click.echo(shown(hidden(str(line)), sys.stderr if err else sys.stdout), err=err)


def say_all(text: str) -> None:
    """Print a text of several lines."""
    for line in text.removesuffix("\n").split("\n"):
        say(line)


def print_json(data: Mapping[str, Any]) -> None:
    """Print one JSON document with the version of its format."""
    say_json({"version": 1, **data})


def say_json(data: Mapping[str, Any], indent: int | None = None) -> None:
    """Print data as JSON, in ASCII unless the stream is UTF-8."""
    text = json.dumps(_without_credentials(data), ensure_ascii=False, allow_nan=False, indent=indent)
    unicode = codecs.lookup(sys.stdout.encoding or "utf-8").name == "utf-8"
    click.echo(NOT_ASCII.sub(lambda c: c[0] if unicode and c[0].isprintable() else _in_json(c[0]), text))


def shown(line: str, stream: TextIO) -> str:
    """Return a line as a stream can show it: printable, in its encoding."""
    encoding = stream.encoding or "utf-8"
    return printable(line).encode(encoding, "backslashreplace").decode(encoding)


def _in_json(character: str) -> str:
    return UNIT.sub(r"\\u\g<0>", character.encode("utf-16-be", "surrogatepass").hex())


def _without_credentials(data: Any) -> Any:
    if isinstance(data, str):
        return hidden(data)
    if isinstance(data, Mapping):
        return {key: _without_credentials(value) for key, value in data.items()}
    return [_without_credentials(value) for value in data] if isinstance(data, list | tuple) else data


def print_pairs(pairs: Sequence[tuple[str, Any]]) -> None:
    """Print names and values, one pair per line."""
    names = [printable(name) for name, _ in pairs]
    width = max(map(len, names))
    for name, (_, value) in zip(names, pairs, strict=True):
        say(f"{name.ljust(width)}  {value}")


def print_table(names: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print columns of text under their names, the first aligned left and the others right."""
    lines = [[printable(cell) for cell in row] for row in (names, *rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        cells = [
            x.ljust(w) if i == 0 else x.rjust(w) for i, (x, w) in enumerate(zip(line, widths, strict=True))
        ]
        say("  ".join(cells))


def print_list(names: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a name, a number and a text per line; the last column may be of any length."""
    lines = [[printable(cell) for cell in row] for row in (names, *rows)]
    first, second = (max(len(line[i]) for line in lines) for i in (0, 1))
    for name, number, text in lines:
        say(f"{name.ljust(first)}  {number.rjust(second)}  {text}".rstrip())


def problems_json(problems: Sequence[Any]) -> list[Mapping[str, Any]]:
    """Return problems as JSON, each with the file, row and rule."""
    return [problem._asdict() for problem in problems]


def report_problems(problems: Sequence[Any], fine: str, quiet: bool) -> None:
    """Print `fine` if there are no problems; else print them on stderr and exit with code 3."""
    if not problems:
        if not quiet:
            say(fine)
        return
    for problem in problems[:MAX_LINES]:
        say(problem, err=True)
    if len(problems) > MAX_LINES:
        say(f"and {len(problems) - MAX_LINES:,} more", err=True)
    raise SystemExit(3)


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
