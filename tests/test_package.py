"""The package as a whole: its public names, its errors, and the places of its files."""

from __future__ import annotations

import dataclasses
import inspect
import pickle
import re
from pathlib import Path

import click
import pytest
from helpers import ROOT

import ibdata
from ibdata import dynamics
from ibdata.cli import cli
from ibdata.errors import ConfigError, Interrupted, UsageError, missing, parameter
from ibdata.views.options import ViewOptions

PACKAGE = ROOT / "ibdata"
TEXTS = {
    path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")
}
LONGEST = 350  # lines; most files have fewer than 200
NO_ROOMS = "bridges corpus docs faults helpers life naive reference results same_bits"  # of tests
AT_THE_ROOT = "__init__ __main__ errors published testing version"
NAMES = """
Dataset Experiment IbdataError __version__ baselines card estimate evaluate export finalize
generate importance load make merge noise_floor open quality repair reproduce rollouts save_network
score_model split state_at true_values validate
"""
DYNAMICS = "PAPER SIEMENS VARIANTS Noise State Variant initial_state step"
SCRIPTS = [
    path
    for folder in ("scripts", "studies")
    for path in (ROOT / folder).rglob("*")
    if path.is_file() and path.suffix in ("", ".py")
]


def lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


def test_no_file_is_too_long_to_be_read_at_once():
    files = [*PACKAGE.rglob("*.py"), *SCRIPTS]
    assert {str(path): len(lines(path)) for path in files if len(lines(path)) > LONGEST} == {}


def test_modules_live_in_rooms():
    """The map of the house names each, and the tests of a room stand in a folder of its name."""
    assert {path.stem for path in PACKAGE.glob("*.py")} == set(AT_THE_ROOT.split())
    rooms = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    named = re.findall(r"^- ([\w, ]+):", ibdata.__doc__, re.MULTILINE)
    assert rooms == {name for line in named for name in line.split(", ")}
    folders = {path.name for path in (ROOT / "tests").iterdir() if any(path.glob("test_*.py"))}
    assert folders - set(NO_ROOMS.split()) <= {name.lstrip("_") for name in rooms}


def test_the_public_names():
    assert ibdata.__all__ == NAMES.split()
    assert all(hasattr(ibdata, name) for name in ibdata.__all__)
    assert ibdata.open is ibdata.Dataset
    assert dynamics.__all__ == DYNAMICS.split()
    with pytest.raises(AttributeError, match="module 'ibdata' has no attribute 'nonsense'"):
        ibdata.nonsense  # noqa: B018 - the access is the test


def test_no_module_names_pickle_or_evaluates_text():
    """Loading a pickle runs code."""
    pickles = (
        r"\b(pickle|cPickle|dill|cloudpickle|joblib|marshal|shelve)\b|allow_pickle=True|\beval\(|\bexec\("
    )
    assert len(TEXTS) > 90
    found = {name for name, text in TEXTS.items() if re.search(pickles, text)}
    # The first makes an expression of the fields that it declares, the second runs what a user allowed.
    assert found == {"dynamics/variants.py", "policies/code.py"}


def test_modules_that_simulate_keep_nothing_from_one_call_to_the_next():
    """But for what pure functions of their arguments, and of files of the package, return."""
    cached = set()
    for name, text in TEXTS.items():
        if name.startswith(("policies/", "experiment/", "evaluation/")):
            cached |= set(
                re.findall(r"^@(?:functools\.)?(?:lru_)?cache\b.*\n(?:@.*\n)*def (\w+)", text, re.M)
            )
            assert not re.search(r"^ +global ", text, re.M), name
    assert cached == {"numbers", "sequence", "waves", "_any_policy", "is_installed"}


# An option in a message; commands, which are to be typed as they are, are passed over.
OPTION = re.compile(r"ibdata [a-z]+ [^;]*|(?<![\w=/-])--([a-z]+(?:-[a-z]+)*)")


@pytest.mark.parametrize(
    "error",
    [
        ConfigError(["a: b", "c: d"]),
        Interrupted(15),
        missing("this", "that", "extra"),
        UsageError(parameter("a")),
    ],
    ids=repr,
)
def test_an_error_survives_the_way_between_processes(error):
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.exit_code) == (type(error), str(error), error.exit_code)
    assert isinstance(again, ImportError) == str(error).startswith("this needs")


def test_a_parameter_in_a_message_exists_in_both_interfaces():
    """No message outside the command line has an option of it; a marked parameter is one of both."""
    context = click.Context(cli)
    commands = [cli.get_command(context, name) for name in cli.list_commands(context)]
    opts = {name for each in commands for option in each.params for name in option.opts}
    options = {name[2:].replace("-", "_") for name in opts}
    functions = [
        getattr(ibdata, name) for name in ibdata.__all__ if name not in ("IbdataError", "__version__")
    ]
    keywords = {keyword for each in functions for keyword in inspect.signature(each).parameters}
    keywords |= {field.name for field in dataclasses.fields(ViewOptions)}
    marked = {name for text in TEXTS.values() for name in re.findall(r"parameter\(['\"](\w+)", text)}
    assert marked | {"out", "shards", "split", "workers", "overwrite", "allow_code"} <= options & keywords
    for name, text in TEXTS.items():
        if name.partition("/")[0] not in ("cli", "errors.py"):
            found = {option for line in re.findall(r'"(.*)"', text) for option in OPTION.findall(line)}
            assert found <= {""}, name
