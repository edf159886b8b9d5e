"""What holds of every format holds of Minari's: the tests of tests/exporters that take a format."""

from __future__ import annotations

import inspect

import pytest
from exporters import test_conformance
from exporters.conftest import dataset  # noqa: F401


@pytest.fixture
def to() -> str:
    return "minari"


_tests = {name: test for name, test in vars(test_conformance).items() if name.startswith("test_")}
del test_conformance
globals().update({name: test for name, test in _tests.items() if "to" in inspect.signature(test).parameters})
