"""The experiments and policies that a shell completes."""

from __future__ import annotations

from collections.abc import Iterable

import click
from click.shell_completion import CompletionItem

from ibdata.cli._options import completing


def _experiments(ctx: click.Context) -> Iterable[str]:
    from ibdata.experiment.shipped import shipped, suites

    return [*suites(), *shipped()]


def _policies(ctx: click.Context) -> Iterable[str]:
    from ibdata.policies import POLICIES

    return POLICIES


_shipped = completing(_experiments)
policies = completing(_policies)


def configs(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Files, and the shipped experiments."""
    return [CompletionItem(incomplete, type="file"), *_shipped(ctx, param, incomplete)]
