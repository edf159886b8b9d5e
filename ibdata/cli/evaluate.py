"""The command evaluate: new episodes of policies, tables of algorithms, and tables that are played again."""

import glob
import re
from collections.abc import Iterable
from fnmatch import filter as filter_names
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource
from click.shell_completion import CompletionItem

from ibdata.cli._options import (
    LOCAL,
    YAML,
    allow_code_option,
    cost_option,
    one_or_several,
    progress_option,
    reward_option,
)
from ibdata.cli._printing import Printable, Printed, prints_result
from ibdata.dataset.tabular import as_text
from ibdata.errors import UsageError

LABELLED = re.compile(r"([A-Za-z0-9_+-]+)=(.+)", re.DOTALL)


def _labelled(words: Iterable[str]) -> list[Any]:
    """The policies that words such as safe, bc=runs/bc.safetensors and 'bc=runs/bc-*.safetensors' name."""
    from ibdata.policies.weights_file import shipped_names

    given: list[Any] = []
    for word in words:
        match = None if Path(word).is_file() else LABELLED.fullmatch(word)
        label, text = match.groups() if match else (None, word)
        texts = [text]
        if glob.has_magic(text) and "{" not in text and ": " not in text and not Path(text).exists():
            texts = sorted(glob.glob(str(Path(text).expanduser()))) or filter_names(shipped_names(), text)
            if not texts:
                raise UsageError(f"{word}: found no such file, expected at least one")
        given += [{label: texts}] if label else texts
    return given


def _refuse_beside(option: str, *allowed: str) -> None:
    """Raise UsageError for an option or argument on the command line beside one that needs no others."""
    context = click.get_current_context()
    for parameter in context.command.params:
        source = context.get_parameter_source(str(parameter.name))
        if source is ParameterSource.COMMANDLINE and parameter.name not in (option, *allowed):
            raise UsageError(
                f"{parameter.opts[0]}: found it beside --{option}, which has its own; leave it out"
            )


def _kinds(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """The kinds of policies and the shipped networks that begin as the incomplete word does."""
    from ibdata.policies import NAMED
    from ibdata.policies.weights_file import shipped_names

    return [CompletionItem(name) for name in (*NAMED, *shipped_names()) if name.startswith(incomplete)]


@click.command("evaluate")
@click.argument("policies", nargs=-1, metavar="[POLICY]…", shell_complete=_kinds)
@click.option(
    "--policy",
    "more_policies",
    multiple=True,
    metavar="POLICY",
    shell_complete=_kinds,
    help="Same as the argument POLICY; may be repeated.",
)
@click.option(
    "--setpoint",
    type=YAML,
    multiple=True,
    callback=one_or_several,
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
@click.option("--wide", is_flag=True, help="Print all columns, for which 80 characters are not enough.")
@click.option(
    "--save",
    type=LOCAL,
    multiple=True,
    metavar="FILE",
    help="Write the table to FILE.tex (LaTeX), FILE.md, FILE.csv, or FILE.json for --again; may be repeated.",
)
@click.option("--overwrite", is_flag=True, help="Replace files that exist.")
@click.option(
    "--again", type=LOCAL, metavar="FILE.json", help="Play a saved table again; exit code 3 if it differs."
)
@click.option(
    "--with",
    "files",
    type=LOCAL,
    multiple=True,
    metavar="FILES",
    help="With --again: a file of weights or a folder of them, besides the folder of FILE.json.",
)
@allow_code_option
@progress_option
@prints_result
def evaluate_command(
    policies: tuple[str, ...],
    more_policies: tuple[str, ...],
    setpoint: Any,
    reward: Any,
    cost: Any,
    wide: bool,
    save: tuple[Path, ...],
    overwrite: bool,
    again: Path | None,
    files: tuple[Path, ...],
    **settings: Any,
) -> Printable:
    """Simulate new episodes with policies and compare their returns.

    POLICY is a kind of policy, a shipped network, a block such as '{kind: safe}', a file with a block, or a
    file of weights; or LABEL= and one of these, or several such as 'iql=runs/iql-*.safetensors'. Policies of
    one label are trainings of one algorithm with several seeds.

    \b
    ibdata evaluate optimized
    ibdata evaluate safe random --steps 1000 --discount 1
    ibdata evaluate safe --setpoint 10 --setpoint 100
    ibdata evaluate '{kind: gaussian, base: {kind: bad}, scale: 0.1}'
    ibdata evaluate safe expert --cost '{fatigue: 60, budget: 25}'
    ibdata evaluate safe --against optimized-40
    ibdata evaluate safe --against random --start '{burn_in: [15, 64]}'
    ibdata evaluate 'iql=runs/iql-*.safetensors' --against random --save t.tex
    ibdata evaluate 'iql=random-iql-*' 'bc=random-bc-*' --against random
    ibdata evaluate --again t.json --with runs
    """
    from ibdata.evaluation import evaluate
    from ibdata.evaluation.again import evaluate_again
    from ibdata.evaluation.saving import place_of

    named = [*policies, *more_policies]
    if again is not None:
        _refuse_beside("again", "files", "allow_code", "progress", "as_json")
        found, problems = evaluate_again(again, files, settings["allow_code"], settings["progress"])
        said = "differs from" if problems else "is the same as"
        return Printed(
            {"problems": problems, **found.plain()}, f"What was played again {said} {again}", problems
        )
    if files:
        raise UsageError("--with: found it without --again, whose networks it has; leave it out")
    if not named:
        raise click.UsageError("Missing argument 'POLICY'; ibdata config policies lists the kinds.")
    for path in save:
        place_of(path, overwrite)
    found = evaluate(_labelled(named), setpoint, view={"reward": reward, "cost": cost}, **settings)
    for path in save:
        found.save(path, overwrite)
    return Printed(found.plain(), "\n\n".join(map(as_text, found.tables(wide))))
