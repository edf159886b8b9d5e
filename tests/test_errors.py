"""Errors come back from worker processes unchanged, and name options as the caller knows them."""

from __future__ import annotations

import inspect
import pickle
import re
from pathlib import Path

import click
import pytest

import ibdata
from ibdata.cli import cli
from ibdata.errors import OPTION, SWITCHES, ConfigError, IbdataError, Interrupted, MissingError


@pytest.mark.parametrize(
    "error", [ConfigError(["a: b", "c: d"]), Interrupted(15), MissingError("this", "that", "extra")], ids=repr
)
def test_an_error_survives_the_way_between_processes(error):
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.exit_code) == (type(error), str(error), error.exit_code)


def test_a_missing_library_is_an_import_error_too():
    assert issubclass(MissingError, ImportError)


def test_a_message_names_options_as_python_does_and_as_the_command_line_does():
    error = IbdataError("x: exists already; choose another --out, or --overwrite; run ibdata a --out x")
    assert str(error) == "x: exists already; choose another out=…, or overwrite=True; run ibdata a --out x"
    assert error.with_options == error.args[0]
    problems = ConfigError(
        ["--set steps=0: steps: found 0", "--seed: found -1", "x.yaml:1:1: found a--set b"]
    )
    assert problems.problems == (
        "overrides: steps=0: steps: found 0",
        "seed: found -1",
        "x.yaml:1:1: found a--set b",
    )


def test_every_option_in_a_message_is_an_option_of_a_command_and_a_keyword_in_python():
    commands = [cli.get_command(click.Context(cli), name) for name in cli.list_commands(click.Context(cli))]
    options = {name[2:]: option for each in commands for option in each.params for name in option.opts}
    functions = [
        getattr(ibdata, name) for name in ibdata.__all__ if name not in ("IbdataError", "__version__")
    ]
    keywords = {keyword for each in functions for keyword in inspect.signature(each).parameters}
    package = Path(ibdata.__file__).parent
    found = set()
    for path in package.rglob("*.py"):
        if path.relative_to(package).parts[0] not in ("cli", "errors.py", "plots"):
            for text in re.findall(r'"(.*)"', path.read_text(encoding="utf-8")):
                found |= {option["name"] for option in OPTION.finditer(text)} - {None}
    assert {"out", "overwrite", "resume", "set", "shards"} <= found <= options.keys()
    assert {name.replace("-", "_") for name in found - {"set"}} <= keywords
    assert {name for name in found if options[name].is_flag} == set(SWITCHES)
