"""Every argument and option of every command reaches the library: a table of command lines and calls."""

import inspect
import json
import math
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from ibdata.cli import cli
from ibdata.dataset.dataset import Dataset
from ibdata.experiment import Experiment

# A command line; the library function that it calls; the arguments of this call. $D is a dataset, $S a folder
# of experiments. An experiment is shown by its seed and its steps.
DATA, SUITE = "$D", "$S"
RUN = {"workers": 3, "allow_code": True, "progress": False, "engine": "ray", "address": "a"}
LOADED = {"overrides": ("steps=7", "episodes=2"), "seed": 5}
CHANGES = "--set steps=7 --set episodes=2 --seed 5"
RUNNING = "--workers 3 --allow-code --quiet --engine ray --address a"
PREVIEWED = {"workers": 3, "allow_code": True}
CHOICE = "--split target --setpoint 70 --policy random --policy calm --episodes 0-2,5 --returns -inf 3"
CHOSEN = {"split": "target", "setpoint": 70.0, "policy": ["random", "calm"], "episodes": [0, 1, 2, 5],
          "returns": [-math.inf, 3.0]}  # fmt: skip
SELECT = "ibdata.dataset.dataset.Dataset.select"
TABLE: list[tuple[str, str, dict[str, Any]]] = [
    ("card $D --overwrite", "ibdata.tools.card.card", {"folder": DATA, "overwrite": True}),
    (f"config validate random {CHANGES}", "ibdata.experiment.load_all", {"config": "random", **LOADED}),
    (f"config show random {CHANGES}", "ibdata.experiment.load", {"config": "random", **LOADED}),
    (
        "evaluate safe --policy bad --setpoint 50 --setpoint 70 --steps 4 --discount .5 --episodes 6"
        " --start {'burn_in':[3,9]} --dynamics {'eta_mean':.1} --reward delta --cost runaway --seed 7"
        " --against optimized-40 --allow-code -q",
        "ibdata.evaluation.evaluate",
        {"policy": ["safe", "bad"], "setpoint": [50, 70], "steps": 4, "discount": 0.5, "episodes": 6,
         "start": {"burn_in": [3, 9]}, "dynamics": {"eta_mean": 0.1}, "seed": 7,
         "view": {"reward": "delta", "cost": "runaway"},
         "against": "optimized-40", "allow_code": True, "progress": False},
    ),
    (
        "evaluate --again t.json --with a --with b --allow-code --quiet",
        "ibdata.evaluation.again.evaluate_again",
        {"path": "t.json", "files": ["a", "b"], "allow_code": True, "progress": False},
    ),
    (
        "evaluate safe --episodes 2 --steps 2 --save t.tex --overwrite",
        "ibdata.evaluation.results.Evaluation.save",
        {"path": "t.tex", "overwrite": True},
    ),
    (
        "evaluate safe --episodes 2 --steps 2 --wide",
        "ibdata.evaluation.results.Evaluation.tables",
        {"wide": True},
    ),
    (
        "export $D --to csv --out o --history 3 --reward-scale .5 --observe markov --actions"
        " --reward delta --imperfections {'seed':1} --cost {'fatigue':60} --id a/b-v1 --overwrite --quiet",
        "ibdata.exporters.export",
        {"dataset": DATA, "to": "csv", "out": "o", "history": 3,
         "view": {"observe": "markov", "actions": True, "reward": "delta", "reward_scale": 0.5,
                  "imperfections": {"seed": 1}, "cost": {"fatigue": 60}},
         "id": "a/b-v1", "overwrite": True, "progress": False},
    ),
    (f"export $D --to csv --out o {CHOICE}", SELECT, CHOSEN),
    (f"plot $D {CHOICE}", SELECT, CHOSEN),
    (f"stats $D {CHOICE}", SELECT, CHOSEN),
    ("finalize o", "ibdata.generation.generate.finalize", {"folder": "o"}),
    (
        f"generate random --out o {CHANGES} {RUNNING}",
        "ibdata.generation.generate.generate",
        {"config": "random", "out": "o", "overwrite": False, "shards": None, **LOADED, **RUN},
    ),
    (
        "generate --config safe --overwrite",
        "ibdata.generation.generate.generate",
        {"config": "safe", "out": None, "overwrite": True, "workers": None, "seed": None,
         "overrides": (), "shards": None, "allow_code": False, "progress": None, "engine": "local",
         "address": None},
    ),
    (
        f"generate $S --out o {CHANGES} {RUNNING} --shards 1/2",
        "ibdata.generation.generate.generate",
        {"config": SUITE, "out": "o", "overwrite": False, "shards": "1/2", **LOADED, **RUN},
    ),
    (
        f"generate $S --out o {CHANGES} --workers 3 --allow-code --dry-run",
        "ibdata.generation.estimate.estimate",
        {"config": SUITE, "out": "o", "overwrite": False, **LOADED, "allow_code": True},
    ),
    (
        "head $D -n 3 --columns step,reward --split target",
        "ibdata.dataset.dataset.Dataset.head",
        {"rows": 3, "columns": ["step", "reward"], "split": "target", "at": None},
    ),
    (
        "head $D --at 3 4",
        "ibdata.dataset.dataset.Dataset.head",
        {"rows": 5, "columns": None, "split": None, "at": (3, 4)},
    ),
    ("info $D", "ibdata.dataset.dataset.Dataset.__init__", {"path": DATA}),
    ("init mine.yaml", "ibdata.experiment.catalogue.write_template", {"file": "mine.yaml"}),
    ("ls o", "ibdata.tools.listing.datasets_in", {"folder": "o"}),
    ("merge a b c --out o", "ibdata.tools.merge.merge", {"folders": ("a", "b", "c"), "out": "o"}),
    (
        "plot $D --out o --format svg --overwrite --quiet",
        "ibdata.cli.use.plot",
        {"dataset": DATA, "out": "o", "form": "svg", "overwrite": True, "progress": False},
    ),
    (
        "repair $D --workers 3 --allow-code",
        "ibdata.tools.repair.repair",
        {"folder": DATA, **PREVIEWED},
    ),
    (
        "reproduce $D --episodes 3 --allow-code",
        "ibdata.tools.reproduce.reproduce",
        {"folder": DATA, "episodes": 3, "allow_code": True},
    ),
    (
        "split $D a.setpoint=1 b.policy=[safe,random] a.episodes=2 --remove e --remove f --materialize o",
        "ibdata.tools.split.split",
        {"dataset": DATA,
         "splits": {"a": {"setpoint": 1, "episodes": 2}, "b": {"policy": ["safe", "random"]}},
         "remove": ("e", "f"), "materialize": "o"},
    ),
    (
        "split $D --by transfer source=20 target=70",
        "ibdata.tools.split.split",
        {"dataset": DATA, "remove": (), "materialize": None,
         "splits": {"source": {"setpoint": 20}, "target": {"setpoint": 70}, "target-rest": None}},
    ),
    ("split $D --list", "ibdata.dataset.dataset.Dataset.splits", {}),
    ("stats $D", "ibdata.dataset.dataset.Dataset.statistics", {}),
    ("stats $D --quality", "ibdata.dataset.quality.quality", {"ds": DATA}),
    (
        "validate $D --quick --quiet",
        "ibdata.tools.validate.validate",
        {"folder": DATA, "quick": True, "progress": False},
    ),
]  # fmt: skip
PRINTED = {"as_json"}  # options of what a command prints: tests/cli/test_commands.py


class Called(Exception):
    """The library function was called, with these arguments."""


def plain(value: Any) -> Any:
    """A value as the table has it."""
    if isinstance(value, Experiment):
        return [value.seed, value.steps]
    if isinstance(value, Dataset):
        value = value.place
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    return str(value) if isinstance(value, Path) else value


def recording(name: str) -> Any:
    """A stand-in for the function or property `name`, which raises `Called`."""
    owner, _, attribute = name.rpartition(".")
    module, _, kind = owner.rpartition(".") if owner[owner.rfind(".") + 1].isupper() else (owner, "", "")
    place = __import__(module, fromlist=["_"])
    real = inspect.getattr_static(getattr(place, kind) if kind else place, attribute)
    signature = inspect.signature(real.fget if isinstance(real, property) else real)

    def called(*args: Any, **kwargs: Any) -> Any:
        arguments = signature.bind(*args, **kwargs).arguments
        arguments.pop("self", None)
        arguments |= arguments.pop("options", {}) | arguments.pop("kwargs", {})
        raise Called(arguments)

    return property(called) if isinstance(real, property) else called


@pytest.mark.parametrize(("line", "name", "expected"), TABLE, ids=[row[0].split(" -")[0] for row in TABLE])
def test_arguments_and_options_reach_the_library(dataset, tmp_path, monkeypatch, line, name, expected):
    (tmp_path / "suite").mkdir()
    (tmp_path / "suite/one.yaml").write_text("name: one\nsetpoints: [50]\npolicies: [random]\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(name, recording(name))
    places = {DATA: str(dataset.path), SUITE: "suite"}
    done = CliRunner().invoke(cli, [places.get(word, word) for word in line.split()])
    assert isinstance(done.exception, Called), done.output
    (found,) = done.exception.args
    shown = json.dumps(plain(expected))
    for word, place in places.items():
        shown = shown.replace(f'"{word}"', json.dumps(place))
    assert plain(dict(found)) == json.loads(shown)


def parameters(command: click.Command, path: str = "") -> set[tuple[str, str]]:
    """Every command with each of its parameters, of its own subcommands too."""
    found = {(path, each.name or "") for each in command.params} - {(path, name) for name in PRINTED}
    if isinstance(command, click.Group):
        for name in command.list_commands(click.Context(command)):
            below = command.get_command(click.Context(command), name)
            assert below is not None
            found |= parameters(below, f"{path} {name}".strip())
    return found


def given(line: str) -> set[tuple[str, str]]:
    """The command of a line with the parameters that it gives."""
    command, path, words = cli, "", line.split()
    while isinstance(command, click.Group):
        path = f"{path} {words[0]}".strip()
        command = command.get_command(click.Context(command), words.pop(0))
    context = click.Context(command)
    command.parse_args(context, words)
    known = click.core.ParameterSource.COMMANDLINE
    return {(path, each.name) for each in command.params if context.get_parameter_source(each.name) == known}


def test_the_table_has_every_parameter_of_every_command():
    in_table = set().union(*(given(line) for line, _, _ in TABLE))
    assert in_table == {(path, name) for path, name in parameters(cli) if path}
