"""The matrix: each row is a child process with its own settings."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from helpers import PACKAGE, ROOT

CHILD = ROOT / "tests" / "same_bits" / "child.py"
# Prefixes of environment variables that settings use; a row has only those that it sets itself.
VARIABLES = ("NPY_", "NUMBA_", "OPENBLAS_", "GLIBC_TUNABLES", "IBDATA_", "PYTHONPATH", "OMP_", "LD_")
# What the kernel says of the processor: numpy, numba and the C library are to find the same.
CPUINFO = Path("/proc/cpuinfo")
PROCESSOR = CPUINFO.read_text().split() if CPUINFO.exists() else []
HAS_AVX512, HAS_FMA = "avx512f" in PROCESSOR, "fma" in PROCESSOR
SIZE = "full" if os.environ.get("IBDATA_SAME_BITS") == "full" else "small"


@dataclass(frozen=True)
class Row:
    """A setting: environment variables, the spec of child.py, and the Python and package to use."""

    name: str
    env: dict[str, str] = field(default_factory=dict)
    spec: dict[str, Any] = field(default_factory=dict)
    own_code: bool = False  # compile again, instead of using the machine code of the unmodified row
    python: str = sys.executable
    package: Path = PACKAGE

    @property
    def size(self) -> str:
        """The size of the experiments, which selects the golden roots."""
        return str(self.spec.get("size", SIZE))


UNMODIFIED = Row("unmodified", spec={"expect": {"DISABLE_JIT": 0, "CPU_NAME": None, "CPU_FEATURES": None}})


class Matrix:
    """Starts rows and keeps their results."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.pool = ThreadPoolExecutor(max(2, len(os.sched_getaffinity(0))))
        self.started: dict[str, Future[dict[str, Any]]] = {}

    def start(self, rows: Iterable[Row]) -> None:
        """Start the rows that have not been started; the unmodified row is always the first."""
        for row in (UNMODIFIED, *rows):
            if row.name not in self.started:
                self.started[row.name] = self.pool.submit(self._run, row)

    def result(self, row: Row) -> dict[str, Any]:
        """Return the output of a row's child. Raises AssertionError with its stderr if it failed."""
        self.start([row])
        return self.started[row.name].result()

    def _run(self, row: Row) -> dict[str, Any]:
        if not (row.own_code or row == UNMODIFIED):
            self.result(UNMODIFIED)
        child = self.child(row)
        assert child.returncode == 0, f"{row.name}: {child.stderr}"
        return {**json.loads(child.stdout), "stderr": child.stderr}

    def place(self, row: Row) -> Path:
        """The folder of a row's datasets."""
        return self.folder / row.name.replace(" ", "-").replace("/", "-")

    def child(self, row: Row, code: Path | None = None) -> subprocess.CompletedProcess[str]:
        """Run the child of a row now, with `code` as the folder of machine code if it is given."""
        place = self.place(row)
        place.mkdir()
        env = {k: v for k, v in os.environ.items() if not k.startswith(VARIABLES)}
        env["PYTHONPATH"] = str(row.package)
        env["IBDATA_CACHE_DIR"] = str(code or (place / "code" if row.own_code else self.folder / "code"))
        spec = {"size": SIZE, "folder": str(place), **row.spec}
        return subprocess.run(
            # numpy only warns (ImportWarning, hidden by default) if it does not know a feature's name
            [row.python, "-W", "error::ImportWarning", str(CHILD), json.dumps(spec)],
            env=env | row.env,
            capture_output=True,
            text=True,
            timeout=3600,
            check=False,
        )
