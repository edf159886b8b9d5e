"""Helpers that several tests share. A test imports them by `from helpers import …`."""

from __future__ import annotations

import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[2]  # of the repository


def script(name: str) -> ModuleType:
    """Import a file of scripts/ or studies/, which an import statement cannot find without a suffix."""
    [path] = [path for path in (ROOT / "scripts" / name, ROOT / "studies" / name) if path.exists()]
    loader = SourceFileLoader(f"script_{name}", str(path))
    module = module_from_spec(spec_from_loader(loader.name, loader))
    sys.modules[loader.name] = module
    loader.exec_module(module)
    return module
