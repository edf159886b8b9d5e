"""What commands share: groups, help that ends with a list, arguments, options, and what a shell completes."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from ibdata.errors import UsageError, notice, suggestion

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
    """The first paragraph of the docstring of each module, which is not imported, because that takes long."""
    (folder,) = import_module(package).__path__
    modules = {name: ast.parse(Path(folder, f"{name}.py").read_bytes()) for name in names}
    return [
        (name, " ".join((ast.get_docstring(code) or "").partition("\n\n")[0].split()))
        for name, code in modules.items()
    ]


class PlaceType(click.Path):
    """A path; a URL is kept as text."""

    def __init__(self, urls: bool = True) -> None:
        super().__init__(path_type=Path)
        self._urls = urls

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        from ibdata._system.storage import is_url, refuse_url

        if not self._urls:
            refuse_url(value)
        return value if is_url(value) else super().convert(value, param, ctx)


class Yaml(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # not generic before click 8.2
    """A value that is given as YAML."""

    name = "YAML"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        from ibdata.experiment.yaml import Document, StrictYamlError

        try:
            return Document(value).data
        except StrictYamlError as error:
            option = param.opts[0] if param else ""
            raise UsageError(f"{option} {value}: {error.message}") from None


MOST_EPISODES = 10_000_000  # of a range
LOCAL, YAML = PlaceType(urls=False), Yaml()


def configs(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Files, and the shipped experiments."""
    from ibdata._system.configs import shipped, suites

    names = [name for name in (*suites(), *shipped()) if name.startswith(incomplete)]
    return [CompletionItem(incomplete, type="file"), *map(CompletionItem, names)]


place_argument = click.argument("folder", metavar="DIR|URL", type=PlaceType())
folder_argument = click.argument("folder", metavar="DIR", type=LOCAL)
set_option = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Override an option of the experiment, e.g. --set episodes=100.",
)
seed_option = click.option("--seed", type=int, metavar="N", help="Override the seed of the experiment.")


def one_or_several(context: click.Context, option: click.Parameter, values: tuple[Any, ...]) -> Any:
    """A value, several as a list, or None."""
    return list(values) if len(values) > 1 else next(iter(values), None)


def _numbers(context: click.Context, option: click.Parameter, text: str | None) -> list[int] | None:
    """The numbers of a text such as 0-9,17."""
    if text is None:
        return None
    numbers: list[int] = []
    for part in text.split(","):
        first, is_range, last = part.strip().partition("-")
        last = last if is_range else first
        if not (first.isdecimal() and last.isdecimal() and 0 <= int(last) - int(first) < MOST_EPISODES):
            raise UsageError(f"--episodes: found {part!r}, expected a number, or a range such as 0-9")
        numbers += range(int(first), int(last) + 1)
    return numbers


def _repeated(name: str, metavar: str, rows: str, kind: type = str) -> Callable[..., Any]:
    help = f"Use only rows {rows}; give it again for several."
    return click.option(name, metavar=metavar, type=kind, multiple=True, callback=one_or_several, help=help)


split_option = _repeated("--split", "NAME", "of this split")
_selection_options = {
    "split": split_option,
    "setpoint": _repeated("--setpoint", "P", "at this setpoint", float),
    "policy": _repeated("--policy", "LABEL", "of this policy"),
    "episodes": click.option(
        "--episodes",
        metavar="N,A-B,…",
        callback=_numbers,
        help="Use only the episodes with these numbers, such as 0-9,17.",
    ),
    "returns": click.option(
        "--returns",
        nargs=2,
        type=float,
        metavar="LOW HIGH",
        help="Use only episodes with a return within these, both included; -inf and inf are no limits.",
    ),
}


def selects(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options that choose episodes; it gets the selection in place of the folder."""

    @wraps(command)
    def chosen(folder: Path | str, **options: Any) -> Any:
        from ibdata.dataset.dataset import Dataset

        conditions = {name: options.pop(name) for name in _selection_options}
        return command(Dataset(folder).select(**conditions), **options)

    for option in reversed(_selection_options.values()):
        chosen = option(chosen)
    return chosen


reward_option = click.option(
    "--reward",
    type=YAML,
    metavar="REWARD",
    default="classic",
    help="The reward: classic, delta, or weights such as '{consumption: 1, fatigue: 1}'.",
)
cost_option = click.option(
    "--cost",
    type=YAML,
    metavar="COST",
    help="A cost beside the reward: runaway, or '{fatigue: 60}' with a limit, and a budget: '{fatigue: 60, "
    "budget: 25}'.",
)
workers_option = click.option(
    "--workers", type=int, metavar="N", help="Worker processes; default: chosen by the work."
)
progress_option = click.option(
    "--quiet", "-q", "progress", flag_value=False, default=None, type=bool, help="Show no progress bar."
)
allow_code_option = click.option(
    "--allow-code",
    is_flag=True,
    help="Allow custom policies that a file names, which run arbitrary Python code. Use only with code you "
    "trust. --debug shows the traceback of an error in it.",
)
