"""The plain Python of the dynamics and its compiled form give the same bits."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numba

import ibdata

CHILD = """
import runpy, sys, numba
assert str(numba.config.DISABLE_JIT) == sys.argv[2], numba.config.DISABLE_JIT
print(runpy.run_path(sys.argv[1])["digest"]())
"""


def test_the_interpreted_run_has_the_bits_of_the_compiled_one(tape):
    """The child turns the compiler off (or on, where this process has it off) and must find it so."""
    other = "0" if numba.config.DISABLE_JIT else "1"
    child = subprocess.run(
        [sys.executable, "-W", "error", "-c", CHILD, tape.__file__, other],
        env=os.environ | {"NUMBA_DISABLE_JIT": other, "PYTHONPATH": str(Path(ibdata.__file__).parents[1])},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert child.returncode == 0, child.stderr
    assert child.stdout.strip() == tape.digest()
