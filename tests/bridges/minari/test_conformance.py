"""The tests of tests/exporters that hold for every format, run for Minari."""

from __future__ import annotations

import inspect

import pytest
from exporters import test_conformance, test_target, test_views
from exporters.conftest import dataset  # noqa: F401


@pytest.fixture
def to() -> str:
    return "minari"


_modules = (test_conformance, test_target, test_views)
_tests = {
    name: test for module in _modules for name, test in vars(module).items() if name.startswith("test_")
}
del test_conformance, test_target, test_views
globals().update({name: test for name, test in _tests.items() if "to" in inspect.signature(test).parameters})
