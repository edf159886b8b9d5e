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
assert numba.config.DISABLE_JIT
print(runpy.run_path(sys.argv[1])["digest"]())
"""


def test_the_interpreted_run_has_the_bits_of_the_compiled_one(tape):
    assert not numba.config.DISABLE_JIT, "run this test with the compiler on: it compares the two"
    root = str(Path(ibdata.__file__).parents[1])
    child = subprocess.run(
        [sys.executable, "-W", "error", "-c", CHILD, tape.__file__],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": root},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert child.returncode == 0, child.stderr
    assert child.stdout.strip() == tape.digest()
