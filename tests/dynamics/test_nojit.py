"""The plain Python of the dynamics and its compiled form give the same bits."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numba
from helpers import ROOT, tape

import ibdata

CHILD = """
import sys, numba
from helpers import tape
assert str(numba.config.DISABLE_JIT) == sys.argv[1], numba.config.DISABLE_JIT
print(tape.digest())
"""


def test_the_interpreted_run_has_the_bits_of_the_compiled_one():
    """The child turns the compiler off (or on, where this process has it off) and must find it so."""
    other = "0" if numba.config.DISABLE_JIT else "1"
    path = os.pathsep.join([str(Path(ibdata.__file__).parents[1]), str(ROOT / "tests")])
    child = subprocess.run(
        [sys.executable, "-W", "error", "-c", CHILD, other],
        env=os.environ | {"NUMBA_DISABLE_JIT": other, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert child.returncode == 0, child.stderr
    assert child.stdout.strip() == tape.digest()
