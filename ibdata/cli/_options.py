"""Arguments and options that several commands share, and what a shell completes in their places."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from ibdata.errors import UsageError


class Place(click.Path):
    """A path; a URL is kept as text."""

    def __init__(self, urls: bool = True) -> None:
        super().__init__(path_type=Path)
        self._urls = urls

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        from ibdata.system.storage import is_url, refuse_url

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
LOCAL, YAML = Place(urls=False), Yaml()


def completing(known: Callable[[], Iterable[str]]) -> Callable[..., list[CompletionItem]]:
    """Offer the known words that begin as the incomplete one does; a failure offers none."""

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        with suppress(Exception):
            return [CompletionItem(word) for word in known() if word.startswith(incomplete)]
        return []

    return complete


def _experiments() -> list[str]:
    from ibdata.experiment.shipped import shipped, suites

    return [*suites(), *shipped()]


def _policies() -> Iterable[str]:
    from ibdata.policies import POLICIES

    return POLICIES


policies = completing(_policies)
_shipped = completing(_experiments)


def configs(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Files, and the shipped experiments."""
    return [CompletionItem(incomplete, type="file"), *_shipped(ctx, param, incomplete)]


place_argument = click.argument("folder", metavar="DIR|URL", type=Place())
folder_argument = click.argument("folder", metavar="DIR", type=LOCAL)
set_option = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Override an option of the experiment, e.g. --set episodes=100.",
)
seed_option = click.option("--seed", type=int, metavar="N", help="Override the seed of the experiment.")


def _one_or_several(context: click.Context, option: click.Parameter, names: tuple[str, ...]) -> Any:
    """A name, several as a list, or None."""
    return list(names) if len(names) > 1 else next(iter(names), None)


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
    return click.option(name, metavar=metavar, type=kind, multiple=True, callback=_one_or_several, help=help)


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
    help="Allow custom policies, which run arbitrary Python code. Use only with code you trust. --debug "
    "shows the traceback of an error in it.",
)
