"""ibdata branch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ibdata.cli._completion import policies as completed_policies
from ibdata.cli._shared import allow_code_option, json_option, place_argument, print_json, print_table
from ibdata.errors import UsageError


@click.command("branch")
@place_argument
@click.option(
    "--policy",
    required=True,
    metavar="NAME|YAML",
    shell_complete=completed_policies,
    help="A kind of policy, a block such as '{kind: safe}', or a file with a block.",
)
@click.option(
    "--at",
    "rows",
    required=True,
    multiple=True,
    metavar="EPISODE:STEP",
    help="The row from whose state the branches begin; may be repeated.",
)
@click.option(
    "--action",
    type=float,
    nargs=3,
    metavar="DV DG DH",
    help="The first action of every branch, clipped to [-1, 1]; the result is then the value of this action. "
    "By default the policy acts from the start; the result is then the value of the state.",
)
@click.option("--steps", type=int, default=100, show_default=True, help="Steps per branch.")
@click.option("--discount", type=float, default=0.97, show_default=True, help="Discount factor, in [0, 1].")
@click.option("--episodes", type=int, default=100, show_default=True, help="Branches of each row.")
@click.option("--seed", type=int, default=0, metavar="N", help="Seed of the random numbers; default 0.")
@allow_code_option
@json_option
def command(
    folder: Path | str,
    policy: str,
    rows: tuple[str, ...],
    action: tuple[float, float, float] | None,
    as_json: bool,
    **settings: Any,
) -> None:
    """Estimate true values in the states behind rows of a dataset.

    From the exact state before a row's action, new episodes branch off, in which the policy acts. The value
    is the mean of their returns.

    \b
    ibdata branch data/random --policy optimized --at 3:500 --at 7:20
    ibdata branch data/random --policy optimized --at 3:500 --action 0 0.5 -1
    """
    from ibdata.evaluation.true_values import true_values

    episodes, steps = zip(*map(_place, rows), strict=True)
    actions = None if action is None else [action] * len(rows)
    found = true_values(folder, {"episode": episodes, "step": steps}, policy, actions, **settings)
    if as_json:
        print_json(found.plain())
        return
    print_table(
        ("episode", "step", "value", "± s.e.", "95 % interval"),
        [
            (
                str(r.episode),
                str(r.step),
                f"{r.value:.2f}",
                "-" if r.standard_error is None else f"{r.standard_error:.2f}",
                "-" if r.interval is None else "[{:.2f}, {:.2f}]".format(*r.interval),
            )
            for r in found.results
        ],
    )


def _place(text: str) -> tuple[int, int]:
    """The episode and the step of a row."""
    episode, _, step = text.partition(":")
    try:
        return int(episode), int(step)
    except ValueError:
        raise UsageError(f"--at: found {text!r}, expected EPISODE:STEP, such as 3:500") from None
