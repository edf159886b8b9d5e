"""Another Python that imports this ibdata."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import ibdata

PACKAGE = Path(ibdata.__file__).parents[1]


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
