"""What the shell offers for a config, a policy, a column or a split. Nothing here may fail or print."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING

import click
from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    from ibdata.dataset.reader import Dataset

Complete = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def _completing(known: Callable[[click.Context], Iterable[str]]) -> Complete:
    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        with suppress(Exception):
            return [CompletionItem(word) for word in known(ctx) if word.startswith(incomplete)]
        return []

    return complete


def configs(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """The shipped experiments, or else files."""
    return [CompletionItem(incomplete, type="file"), *_shipped(ctx, param, incomplete)]


def columns(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """The columns of the dataset for the last of several between commas."""
    before, comma, last = incomplete.rpartition(",")
    return [CompletionItem(before + comma + item.value) for item in _columns(ctx, param, last)]


def _shipped_names(ctx: click.Context) -> Iterable[str]:
    from ibdata.experiment.shipped import shipped, suites

    return [*suites(), *shipped()]


def _policy_kinds(ctx: click.Context) -> Iterable[str]:
    from ibdata.policies import POLICIES

    return POLICIES


def _column_names(ctx: click.Context) -> Iterable[str]:
    return [column.name for column in _dataset(ctx).info_model.columns]


def _split_names(ctx: click.Context) -> Iterable[str]:
    return _dataset(ctx).split_entries


def _dataset(ctx: click.Context) -> Dataset:
    """The dataset on the line; click leaves its argument alone where an option still lacks its value."""
    from ibdata.dataset.reader import Dataset

    return Dataset(ctx.params.get("folder") or ctx.args[0])


_shipped, _columns = _completing(_shipped_names), _completing(_column_names)
policies, splits = _completing(_policy_kinds), _completing(_split_names)
