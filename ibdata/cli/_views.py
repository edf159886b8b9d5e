"""The options of a view, and options that are YAML."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

reward_option = click.option(
    "--reward",
    metavar="REWARD",
    default="classic",
    help="The reward: classic, delta, or weights such as '{consumption: 1, fatigue: 1}'.",
)
VIEW_OPTIONS = [
    click.option(
        "--observe",
        metavar="COLUMNS",
        default="classic",
        help="The observed columns: classic (6 variables), markov (the whole state), or names with commas, "
        "such as obs_gain,latent_mu_v.",
    ),
    click.option("--actions", is_flag=True, help="Observe the action of the step before too."),
    reward_option,
    click.option("--reward-scale", type=float, default=1.0, metavar="X", help="Multiply rewards by X."),
    click.option(
        "--imperfections",
        metavar="YAML",
        help="Delay, noise, rounding and missing values of columns, such as '{delay: {obs_fatigue: 3}}'; "
        "docs/views.md lists them.",
    ),
]


def view_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of a view to a command."""
    for option in reversed(VIEW_OPTIONS):
        command = option(command)
    return command


def view_of(
    observe: str, actions: bool, reward: str, reward_scale: float, imperfections: str | None
) -> dict[str, Any]:
    """The argument `view` of Python. Raises UsageError for text that is not YAML."""
    names = [name.strip() for name in observe.split(",")]
    return {
        "observe": names if len(names) > 1 or names[0].startswith(("obs_", "latent_")) else observe,
        "actions": actions,
        "reward": yaml_value("--reward", reward),
        "reward_scale": reward_scale,
        "imperfections": None if imperfections is None else yaml_value("--imperfections", imperfections),
    }


def yaml_value(option: str, text: str) -> Any:
    """The value of an option, which is YAML. Raises UsageError if it is not."""
    from ibdata.errors import UsageError
    from ibdata.experiment.yaml import Document, StrictYamlError

    try:
        return Document(text).data
    except StrictYamlError as error:
        raise UsageError(f"{option} {text}: {error.message}") from None
