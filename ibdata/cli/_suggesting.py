"""Groups of commands, and help that ends with a list of names."""

import ast
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from ibdata.errors import notice, suggestion

# What other programs call a command, or what a command writes, and the command.
MEANT = {"list": "ls", "report": "card", "check": "validate", "show": "info", "make": "generate"}


class Suggesting(click.Group):
    """A group of commands that suggests a similar command in place of an unknown one."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Without arguments, print the help on stderr; the exit code is 2."""
        if not args and not ctx.resilient_parsing:
            for line in ctx.get_help().split("\n"):
                notice(line, "")
            ctx.exit(2)
        return super().parse_args(ctx, args)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            word, known = args[0], self.list_commands(ctx)
            meant = MEANT.get(word, "")
            hint = f"; did you mean {meant!r}?" if meant in known else suggestion(word, known) or "."
            raise click.UsageError(f"No such command {word!r}{hint}", ctx=error.ctx) from None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write each command with its whole summary, which may take several lines."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, self.summary(ctx, name)) for name in self.list_commands(ctx)])

    def summary(self, ctx: click.Context, name: str) -> str:
        """The first sentence of a command's help."""
        command = self.get_command(ctx, name)
        return command.get_short_help_str(limit=1000) if command else ""


class Listing(click.Command):
    """A command whose help ends with a list of names and descriptions."""

    def __init__(
        self, *args: Any, title: str, entries: Callable[[], list[tuple[str, str]]], **options: Any
    ) -> None:
        super().__init__(*args, **options)
        self._title, self._entries = title, entries

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section(self._title):
            formatter.write_dl(self._entries())


def summaries(package: str, names: Iterable[str]) -> list[tuple[str, str]]:
    """The first paragraph of the docstring of each module."""
    (folder,) = import_module(package).__path__
    return [(name, summary_of(ast.parse(Path(folder, f"{name}.py").read_bytes()))) for name in names]


def summary_of(code: ast.Module | ast.FunctionDef) -> str:
    """The first paragraph of a docstring, from code that is not imported, because that takes long."""
    return " ".join((ast.get_docstring(code) or "").partition("\n\n")[0].split())
