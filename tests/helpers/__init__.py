"""Helpers that several tests share. A test imports them by `from helpers import …`."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import ModuleType
from typing import Any

import ibdata

ROOT = Path(__file__).parents[2]  # of the repository
PACKAGE = Path(ibdata.__file__).parents[1]  # the folder of the ibdata that is tested
# The sizes of tests: small for people, and full with IBDATA_TESTS=full, as in .ci/run.
FULL = os.environ.get("IBDATA_TESTS") == "full"
EXAMPLES = 1 if FULL else 6  # of hypothesis, one of so many is tried


def script(name: str) -> ModuleType:
    """Import a file of scripts/ or studies/, which an import statement cannot find without a suffix."""
    [path] = [path for path in (ROOT / "scripts" / name, ROOT / "studies" / name) if path.exists()]
    loader = SourceFileLoader(f"script_{name}", str(path))
    module = module_from_spec(spec_from_loader(loader.name, loader))
    sys.modules[loader.name] = module
    loader.exec_module(module)
    return module


def tries(full: int) -> Any:
    """So many examples of hypothesis at full size, the same ones every time; fewer where tests are small."""
    from hypothesis import settings

    return settings(derandomize=True, deadline=None, max_examples=full // EXAMPLES)


def python(*arguments, cwd=None, timeout=120):
    """Run Python with these arguments; it may fail."""
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=cwd,
        env=os.environ | {"PYTHONPATH": str(PACKAGE)},
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
