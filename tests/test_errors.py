"""Errors come back from worker processes unchanged, and name parameters as the command line does."""

from __future__ import annotations

import dataclasses
import inspect
import pickle
import re
from pathlib import Path

import click
import pytest

import ibdata
from ibdata.cli import cli
from ibdata.errors import ConfigError, Interrupted, missing
from ibdata.views.options import ViewOptions

# An option in a message; commands, which are to be typed as they are, are passed over.
OPTION = re.compile(r"ibdata [a-z]+ [^;]*|(?<![\w=/-])--(?P<name>[a-z]+(?:-[a-z]+)*)")


@pytest.mark.parametrize(
    "error", [ConfigError(["a: b", "c: d"]), Interrupted(15), missing("this", "that", "extra")], ids=repr
)
def test_an_error_survives_the_way_between_processes(error):
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.exit_code) == (type(error), str(error), error.exit_code)


def test_a_missing_library_is_an_import_error_too():
    assert isinstance(missing("this", "that", "extra"), ImportError)


def test_an_option_in_a_message_exists_in_both_interfaces():
    commands = [cli.get_command(click.Context(cli), name) for name in cli.list_commands(click.Context(cli))]
    options = {name[2:] for each in commands for option in each.params for name in option.opts}
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
    assert {"out", "overwrite", "resume", "shards"} <= found <= options
    of_views = {field.name for field in dataclasses.fields(ViewOptions)}
    allowed = {*keywords, *of_views, "name"}  # the name of `split`, where it is names
    assert {name.replace("-", "_") for name in found} <= allowed
