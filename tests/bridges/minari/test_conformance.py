"""The tests of tests/exporters that hold for every format, run for Minari."""

import inspect

import pytest
from exporters import test_conformance, test_target
from exporters.conftest import dataset  # noqa: F401


@pytest.fixture
def to() -> str:
    return "minari"


def for_every_format(test) -> bool:
    """Whether a test takes its format from the fixture above, and not from a table of its own."""
    tables = [mark.args[0] for mark in getattr(test, "pytestmark", []) if mark.name == "parametrize"]
    return "to" in inspect.signature(test).parameters and "to" not in tables


for _module in (test_conformance, test_target):
    for _name, _test in list(vars(_module).items()):
        if _name.startswith("test_") and for_every_format(_test):
            globals()[_name] = _test
del test_conformance, test_target
