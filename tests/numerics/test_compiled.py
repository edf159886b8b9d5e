"""Machine code is kept between processes, for all copies of ibdata, as long as it is that of their code."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import ibdata

pytestmark = pytest.mark.slow

PACKAGE = Path(ibdata.__file__).parent
TURN = "from ibdata.dynamics.setpoint import steer; print(steer(50.0, 10.0, 1.0))"
FILE = "dynamics/setpoint.py"


def run(script=TURN, package=PACKAGE.parent, **variables):
    """What a child prints that uses a copy of the package, and whether it compiled."""
    others = ("IBDATA_CACHE_DIR", "XDG_CACHE_HOME")
    env = {k: v for k, v in os.environ.items() if k not in others}
    env |= {"PYTHONPATH": str(package), "NUMBA_DISABLE_JIT": "0"}
    child = subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        env=env | {name: str(value) for name, value in variables.items()},
        cwd=package,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert child.returncode == 0, child.stderr
    return child.stdout.strip(), "ibdata: compiling" in child.stderr


@pytest.fixture
def code(tmp_path):
    """A cache folder with the machine code of one function."""
    assert run(IBDATA_CACHE_DIR=tmp_path / "code") == ("60.0", True)
    return tmp_path / "code"


@pytest.fixture
def copy(tmp_path):
    """A copy of the package in another folder."""
    shutil.copytree(PACKAGE, tmp_path / "copy/ibdata", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "copy"


def changed(copy, path, old, new):
    file = copy / "ibdata" / path
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def test_a_second_process_and_a_clone_compile_nothing(code, copy):
    """What one process has compiled, the next one finds, also for a copy in another folder."""
    assert run(IBDATA_CACHE_DIR=code) == ("60.0", False)
    assert run(package=copy, IBDATA_CACHE_DIR=code) == ("60.0", False)


def test_other_places_for_machine_code_are_ignored(code, tmp_path):
    """A user's caches of numba would find outdated code; what else a user sets has its effect."""
    assert run(IBDATA_CACHE_DIR=code, NUMBA_CACHE_LOCATOR_CLASSES="absent.Locator") == ("60.0", False)
    theirs = {"NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator", "NUMBA_CACHE_DIR": tmp_path / "b"}
    assert run(IBDATA_CACHE_DIR=code, **theirs) == ("60.0", False)
    assert run(IBDATA_CACHE_DIR=code, NUMBA_CPU_NAME="nocona") == ("60.0", True)
    assert run(IBDATA_CACHE_DIR=tmp_path / "a", NUMBA_DISABLE_JIT="1") == ("60.0", False)
    assert not (tmp_path / "a/numba").exists()


@pytest.mark.parametrize("first", ["ibdata", "numba"])
def test_numba_reads_no_configuration_in_the_current_folder(first, tmp_path):
    """Neither when it is imported nor when it compiles; what it read before ibdata came has no effect."""
    script = f"""
import os, sys
os.makedirs({str(tmp_path / "cwd")!r}), os.chdir({str(tmp_path / "cwd")!r})
sys.modules["yaml"] = yaml = type(sys)("yaml")  # numba reads no file without it
yaml.reads, yaml.safe_load = [], lambda file: yaml.reads.append(1) or {{"opt": "0", "boundscheck": 1}}
open(".numba_config.yaml", "w").close()
import {first}
before = len(yaml.reads)
{TURN}
import numba
print(before, len(yaml.reads) - before, int(numba.config.OPT), numba.config.BOUNDSCHECK)
"""
    said, compiled = run(script, IBDATA_CACHE_DIR=tmp_path / "code")
    assert compiled
    assert said.splitlines() == ["60.0", f"{int(first == 'numba')} 0 3 None"]


def test_other_code_is_compiled(code, copy):
    """Code that was changed in its own module runs as it is now."""
    changed(copy, FILE, "100.0", "55.0")
    assert run(package=copy, IBDATA_CACHE_DIR=code) == ("55.0", True)


def test_a_number_of_another_module_counts(tmp_path, copy):
    """A constant is compiled in, so its module counts too."""
    script = "from ibdata._numerics.exact import log; print(log(2.0) > 0)"
    assert run(script, package=copy, IBDATA_CACHE_DIR=tmp_path / "c") == ("True", True)
    users = [p for p in (copy / "ibdata/dynamics").glob("*.py") if "numerics.exact import" in p.read_text()]
    name = f"ibdata.dynamics.{users[0].stem}"
    look = f"import {name}; from ibdata._numerics.compiled import _hash; print(_hash('{name}'))"
    before = run(look, package=copy)
    with (copy / "ibdata/_numerics/exact.py").open("a") as file:
        file.write("\nONE_MORE = 7.0\n")
    assert run(look, package=copy) != before
