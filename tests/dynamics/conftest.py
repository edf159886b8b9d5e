"""The helper module `tape.py` as a fixture, since tests do not import each other."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="session")
def tape() -> ModuleType:
    name = "dynamics_tape"
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name("tape.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
