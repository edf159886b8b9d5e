"""The command evaluate."""

from typing import Any

import click

from ibdata.cli._options import YAML, allow_code_option, policies, progress_option, reward_option
from ibdata.cli._printing import Result, prints_result


@click.command("evaluate")
@click.argument("policies", nargs=-1, metavar="[POLICY]…", shell_complete=policies)
@click.option(
    "--policy",
    "more_policies",
    multiple=True,
    metavar="POLICY",
    shell_complete=policies,
    help="Same as the argument POLICY; may be repeated.",
)
@click.option(
    "--setpoint",
    "setpoints",
    type=YAML,
    multiple=True,
    default=["70"],
    metavar="P",
    help="A number (may be repeated), or drifting, or '{drifting: [50, 70]}' with start values; default 70.",
)
@click.option("--steps", type=int, default=100, show_default=True, help="Steps per episode.")
@click.option("--discount", type=float, default=0.97, show_default=True, help="Discount factor, in [0, 1].")
@click.option(
    "--episodes", type=int, help="Episodes per policy and setpoint; default 100, or 200 with --against."
)
@click.option(
    "--start",
    type=YAML,
    default="default",
    metavar="S",
    help="Start state: default, uniform, or '{burn_in: [15, 64]}'.",
)
@click.option(
    "--dynamics",
    type=YAML,
    default="siemens",
    metavar="D",
    help="Dynamics: siemens, paper, or '{base: …, field: value}'.",
)
@reward_option
@click.option("--seed", type=int, default=0, metavar="N", help="Seed of the random numbers; default 0.")
@click.option(
    "--against",
    metavar="SET",
    help="Compare with the shipped results of offline algorithms on an experiment such as optimized-40.",
)
@allow_code_option
@progress_option
@prints_result
def evaluate_command(
    policies: tuple[str, ...],
    more_policies: tuple[str, ...],
    setpoints: tuple[Any, ...],
    reward: Any,
    **settings: Any,
) -> Result:
    """Simulate new episodes with policies and compare their returns.

    POLICY is a kind of policy, a block such as '{kind: safe}', or a file with a block.

    \b
    ibdata evaluate optimized
    ibdata evaluate safe random --steps 1000 --discount 1
    ibdata evaluate safe --setpoint 10 --setpoint 100
    ibdata evaluate '{kind: gaussian, base: {kind: bad}, scale: 0.1}'
    ibdata evaluate safe --against optimized-40
    """
    from ibdata.evaluation import evaluate

    named = [*policies, *more_policies]
    if not named:
        raise click.UsageError("Missing argument 'POLICY'; ibdata config policies lists the kinds.")
    points = list(setpoints) if len(setpoints) > 1 else setpoints[0]
    return evaluate(named, points, view={"reward": reward}, **settings)
