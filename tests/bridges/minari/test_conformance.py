"""What holds of every format holds of Minari's: the tests of tests/exporters that take a format."""

from __future__ import annotations

import inspect
from pathlib import Path
from runpy import run_path

import pytest

CORE = Path(__file__).parents[2] / "exporters"


@pytest.fixture
def to() -> str:
    return "minari"


dataset = run_path(str(CORE / "conftest.py"))["dataset"]
_suite = run_path(str(CORE / "test_conformance.py"))
_tests = {name: test for name, test in _suite.items() if name.startswith("test_")}
globals().update({name: test for name, test in _tests.items() if "to" in inspect.signature(test).parameters})
