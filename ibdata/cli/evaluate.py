"""The command evaluate."""

from typing import Any

import click

from ibdata.cli._options import YAML, allow_code_option, cost_option, policies, progress_option, reward_option
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
    metavar="P",
    help="A number (may be repeated), or drifting, or '{drifting: [50, 70]}' with start values; default 70.",
)
@click.option("--steps", type=int, metavar="N", help="Steps per episode; default 100.")
@click.option("--discount", type=float, metavar="X", help="Discount factor, in [0, 1]; default 0.97.")
@click.option("--episodes", type=int, metavar="N", help="Episodes per policy and setpoint; default 100.")
@click.option(
    "--start",
    type=YAML,
    metavar="S",
    help="Start state: default, uniform, or '{burn_in: [15, 64]}'; default: default.",
)
@click.option(
    "--dynamics",
    type=YAML,
    metavar="D",
    help="Dynamics: siemens, paper, or '{base: …, field: value}'; default siemens.",
)
@reward_option
@cost_option
@click.option("--seed", type=int, metavar="N", help="Seed of the random numbers; default 0.")
@click.option(
    "--against",
    metavar="SET",
    help="Compare with the shipped results on an experiment such as optimized-40 or random, whose settings "
    "are then the default ones.",
)
@allow_code_option
@progress_option
@prints_result
def evaluate_command(
    policies: tuple[str, ...],
    more_policies: tuple[str, ...],
    setpoints: tuple[Any, ...],
    reward: Any,
    cost: Any,
    **settings: Any,
) -> Result:
    """Simulate new episodes with policies and compare their returns.

    POLICY is a kind of policy, a block such as '{kind: safe}', or a file with a block.

    \b
    ibdata evaluate optimized
    ibdata evaluate safe random --steps 1000 --discount 1
    ibdata evaluate safe --setpoint 10 --setpoint 100
    ibdata evaluate '{kind: gaussian, base: {kind: bad}, scale: 0.1}'
    ibdata evaluate safe expert --cost '{fatigue: 60, budget: 25}'
    ibdata evaluate safe --against optimized-40
    ibdata evaluate safe --against random --start '{burn_in: [15, 64]}'
    """
    from ibdata.evaluation import evaluate

    named = [*policies, *more_policies]
    if not named:
        raise click.UsageError("Missing argument 'POLICY'; ibdata config policies lists the kinds.")
    points = list(setpoints) if len(setpoints) > 1 else next(iter(setpoints), None)
    return evaluate(named, points, view={"reward": reward, "cost": cost}, **settings)
