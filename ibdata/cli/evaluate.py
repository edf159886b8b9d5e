"""ibdata evaluate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from ibdata.cli._completion import policies as completed_policies
from ibdata.cli._shared import (
    allow_code_option,
    json_option,
    print_json,
    print_table,
    quiet_option,
    say,
)
from ibdata.cli._views import yaml_value
from ibdata.numerics.naming import exact

if TYPE_CHECKING:
    from ibdata.evaluation import Evaluation


@click.command("evaluate")
@click.option(
    "--policy",
    "policies",
    required=True,
    multiple=True,
    metavar="NAME|YAML",
    shell_complete=completed_policies,
    help="A kind of policy, a block such as '{kind: safe}', or a file with a block; may be repeated.",
)
@click.option(
    "--setpoint",
    "setpoints",
    multiple=True,
    default=["70"],
    metavar="P",
    help="A number (may be repeated), or drifting, or '{drifting: [50, 70]}' with start values; default 70. "
    "A Gymnasium environment has 50.",
)
@click.option("--steps", type=int, default=100, show_default=True, help="Steps per episode.")
@click.option("--discount", type=float, default=0.97, show_default=True, help="Discount factor, in [0, 1].")
@click.option(
    "--episodes",
    type=int,
    default=None,
    help="Episodes per policy and setpoint; default 100, or 200 with --against.",
)
@click.option(
    "--start", default="default", metavar="S", help="Start state: default, uniform, or '{burn_in: [15, 64]}'."
)
@click.option(
    "--dynamics",
    default="siemens",
    metavar="D",
    help="Dynamics: siemens, paper, or '{base: …, field: value}'.",
)
@click.option(
    "--reward",
    default="classic",
    metavar="REWARD",
    help="The reward: classic, delta, or weights such as '{consumption: 1, fatigue: 1}'.",
)
@click.option("--seed", type=int, default=0, metavar="N", help="Seed of the random numbers; default 0.")
@click.option(
    "--against",
    default=None,
    metavar="SET",
    help="Compare with the shipped results of offline algorithms on an experiment such as optimized-40.",
)
@allow_code_option
@quiet_option
@json_option
def command(
    policies: tuple[str, ...],
    setpoints: tuple[str, ...],
    start: str,
    dynamics: str,
    reward: str,
    quiet: bool,
    as_json: bool,
    **settings: Any,
) -> None:
    """Simulate new episodes with policies and compare their returns.

    \b
    ibdata evaluate --policy optimized --setpoint 70
    ibdata evaluate --policy safe --policy random --steps 1000 --discount 1
    ibdata evaluate --policy safe --setpoint 10 --setpoint 100
    ibdata evaluate --policy '{kind: gaussian, base: {kind: bad}, scale: 0.1}'
    ibdata evaluate --policy safe --against optimized-40
    """
    from ibdata.evaluation import evaluate

    points = [yaml_value("--setpoint", text) for text in setpoints]
    evaluation = evaluate(
        list(policies),
        points if len(points) > 1 else points[0],
        start=yaml_value("--start", start),
        dynamics=yaml_value("--dynamics", dynamics),
        reward=yaml_value("--reward", reward),
        progress=False if quiet else None,
        **settings,
    )
    if as_json:
        print_json(evaluation.plain())
        return
    _print(evaluation)


def _print(evaluation: Evaluation) -> None:
    print_table(
        (
            "policy",
            "setpoint",
            "episodes",
            "return",
            "± s.e.",
            "95 % interval",
            "p10",
            "literature",
            "reward/step",
            "clipped",
            "score",
            "± s.e.",
            "expert score",
        ),
        [
            (
                r.policy,
                _setpoint(r.setpoint),
                str(r.episodes),
                f"{r.mean_return:.1f}",
                _number(r.standard_error, 1),
                _interval(r.interval),
                f"{r.p10:.1f}",
                f"{r.mean_return / 100:.2f}",
                f"{r.mean_reward:.2f}",
                f"{100 * r.clipped:.1f} %",
                _number(r.score, 1),
                _number(r.score_error, 1),
                _number(r.expert_score, 1),
            )
            for r in evaluation.results
        ],
    )
    if evaluation.baselines:
        say()
        print_table(
            (f"baseline of {evaluation.baselines[0].set}", "seed", "return", "± s.e.", "p10", "literature"),
            [
                (
                    b.algorithm,
                    "-" if b.seed is None else str(b.seed),
                    _number(b.mean_return, 1),
                    _number(b.standard_error, 1),
                    _number(b.p10, 1),
                    _number(None if b.mean_return is None else b.mean_return / 100, 2),
                )
                for b in evaluation.baselines
            ],
        )
    if evaluation.differences:
        say()
        print_table(
            ("difference", "setpoint", "return", "± s.e.", "95 % interval"),
            [
                (
                    f"{d.policy} - {d.less}",
                    _setpoint(d.setpoint),
                    f"{d.mean_difference:.1f}",
                    _number(d.standard_error, 1),
                    _interval(d.interval),
                )
                for d in evaluation.differences
            ],
        )
    say()
    say(f"return: the sum of {evaluation.discount:g}ᵗ · reward over {evaluation.steps} steps")
    say("literature: the return with rewards / 100; reward/step: the mean reward, not discounted")
    say("clipped: the share of actions outside [-1, 1]")
    if evaluation.scale:
        say(f"score: {evaluation.scale}")
    for note in evaluation.notes:
        reason, _, why = note.partition(": ")
        say(f"- ({reason}): {why}")


def _setpoint(setpoint: float | None) -> str:
    return "all" if setpoint is None else exact(setpoint)


def _number(x: float | None, digits: int) -> str:
    return "-" if x is None else f"{x:.{digits}f}"


def _interval(interval: Sequence[float] | None) -> str:
    return "-" if interval is None else f"[{interval[0]:.1f}, {interval[1]:.1f}]"
