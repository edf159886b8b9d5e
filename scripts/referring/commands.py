"""docs/cli.md: the help of every command."""

from collections.abc import Iterator

import click

from ibdata.cli import cli
from referring import NOTE

OPENING = """\
# Command line

This page is the help of every command, as `-h` prints it. `--debug`, before or after the command, adds the
traceback to an error. Errors go to stderr, results to stdout; with `--json`, stdout holds one JSON document.
[Exit codes](errors.md) are stable. `eval "$(_IBDATA_COMPLETE=bash_source ibdata)"` makes bash complete
commands and options (`zsh_source`, `fish_source` for other shells).
"""
WIDTH = 88


def page() -> str:
    """The page."""
    parts = [NOTE, OPENING, *described(cli, "ibdata", None)]
    return "\n".join(parts).rstrip() + "\n"


def described(command: click.Command, name: str, parent: click.Context | None) -> Iterator[str]:
    """A section for a command, and for each of its subcommands."""
    context = click.Context(
        command, info_name=name, parent=parent, terminal_width=WIDTH, **command.context_settings
    )
    lines = [line.rstrip() for line in command.get_help(context).splitlines()]
    yield f"## {context.command_path}\n\n```text\n" + "\n".join(lines) + "\n```\n"
    if isinstance(command, click.Group):
        for sub in command.list_commands(context):
            if found := command.get_command(context, sub):
                yield from described(found, sub, context)
