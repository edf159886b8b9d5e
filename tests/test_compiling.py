"""Where compiled functions are kept: a folder that the compiled sources name."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import FunctionType

import numba
import pytest
from numba.core.dispatcher import Dispatcher

from ibdata import compiling

pytestmark = pytest.mark.slow

PACKAGE = Path(compiling.__file__).parent

REPORT = """
import os
from ibdata.compiling import FOLDER
from ibdata.dynamics.steering import clip
print(FOLDER)
print(clip(7.0, 0.0, 1.0))
print(sum(name.endswith(".nbc") for _, _, names in os.walk(FOLDER) for name in names))
"""
WITH_A_CHILD = """
import subprocess, sys
from ibdata.compiling import FOLDER
child = "import ibdata.compiling; print(ibdata.compiling.FOLDER)"
print(FOLDER)
print(subprocess.run([sys.executable, "-c", child], capture_output=True, text=True, check=True).stdout)
"""


def covered():
    return {path for pattern in compiling.SOURCES for path in PACKAGE.glob(pattern)}


def compiled_files():
    """The files that decorate a function with `compiled`."""

    def decorates(node):
        return isinstance(node, ast.FunctionDef) and "compiled" in map(ast.unparse, node.decorator_list)

    return [
        path for path in PACKAGE.rglob("*.py") if any(map(decorates, ast.walk(ast.parse(path.read_text()))))
    ]


def run(script, **variables):
    """The lines that a child prints which has these variables for its folders, and no others."""
    env = {k: v for k, v in os.environ.items() if k not in ("IBDATA_CACHE_DIR", "NUMBA_CACHE_DIR")}
    env |= {"PYTHONPATH": str(PACKAGE.parent), "NUMBA_DISABLE_JIT": "0"}
    child = subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        env=env | {name: str(value) for name, value in variables.items()},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert child.returncode == 0, child.stderr
    return child.stdout.split()


@pytest.fixture
def unwritable(tmp_path):
    """Folders that cannot be made, not even by root, and where temporary files go."""
    file = tmp_path / "file"
    file.write_text("not a folder")
    (tmp_path / "tmp").mkdir()
    return {
        "IBDATA_CACHE_DIR": file / "below",
        "NUMBA_CACHE_DIR": file / "below",
        "XDG_CACHE_HOME": file / "below",
        "TMPDIR": tmp_path / "tmp",
    }


@pytest.fixture
def copy(tmp_path, monkeypatch):
    """A copy of the package, of which the digest is taken."""
    folder = tmp_path / "ibdata"
    shutil.copytree(PACKAGE, folder, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(compiling, "PACKAGE", folder)
    return folder


def test_every_file_with_a_compiled_function_is_in_the_digest():
    files = compiled_files()
    assert len(files) > 10
    assert {path.relative_to(PACKAGE) for path in files if path not in covered()} == set()


def test_compiled_files_take_neither_functions_nor_numbers_from_files_outside_the_digest():
    """Numbers of another module are compiled in as constants."""
    for path in compiled_files():
        for node in ast.walk(ast.parse(path.read_text())):
            if not (isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("ibdata")):
                continue
            module = import_module(node.module)
            if Path(module.__file__) in covered():
                continue
            for alias in node.names:
                value = getattr(module, alias.name)
                assert not isinstance(value, FunctionType | Dispatcher | int | float | tuple), (
                    path,
                    alias.name,
                )


def test_every_pattern_of_the_digest_finds_a_file():
    assert [pattern for pattern in compiling.SOURCES if not list(PACKAGE.glob(pattern))] == []


def test_a_change_in_any_covered_file_changes_the_digest(copy):
    digests = {compiling._digest()}
    paths = sorted(covered())
    for path in paths:
        with (copy / path.relative_to(PACKAGE)).open("a") as file:
            file.write("# changed\n")
        digests.add(compiling._digest())
    assert len(digests) == len(paths) + 1


def test_a_new_policy_file_changes_the_digest(copy):
    before = compiling._digest()
    (copy / "policies" / "ramp.py").write_text("# a policy\n")
    assert compiling._digest() != before


def test_a_copy_has_the_same_digest_and_a_change_elsewhere_leaves_it(copy, monkeypatch):
    before = compiling._digest()
    (copy / "version.py").write_text('__version__ = "99"\n')
    assert compiling._digest() == before
    monkeypatch.setattr(compiling, "PACKAGE", PACKAGE)
    assert compiling._digest() == before


def test_another_version_of_the_compiler_changes_the_digest(monkeypatch):
    before = compiling._digest()
    monkeypatch.setattr(numba, "__version__", "0.0.0")
    assert compiling._digest() != before


def test_the_folder_is_named_by_the_digest():
    assert re.fullmatch(r"numba-[0-9a-f]{16}", Path(compiling.FOLDER).name)
    assert Path(compiling.FOLDER).name == f"numba-{compiling._digest()}"


def test_decorating_leaves_the_compilers_own_cache_where_it_was(monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", "elsewhere")

    @compiling.compiled
    def double(x: float) -> float:
        return 2.0 * x

    assert numba.config.CACHE_DIR == "elsewhere"
    assert double(2.0) == 4.0


def test_a_function_that_cannot_be_compiled_leaves_it_too(monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", "elsewhere")

    def refuse(**options):
        raise RuntimeError("no")

    monkeypatch.setattr(numba, "njit", refuse)
    with pytest.raises(RuntimeError, match="no"):
        compiling.compiled(len)
    assert numba.config.CACHE_DIR == "elsewhere"


@pytest.mark.parametrize("variable", ["IBDATA_CACHE_DIR", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME"])
def test_each_variable_can_say_where_the_code_is_kept(variable, tmp_path):
    folder, value, files = run(REPORT, **{variable: tmp_path / "asked"})
    base = tmp_path / "asked" / "ibdata" if variable == "XDG_CACHE_HOME" else tmp_path / "asked"
    assert Path(folder) == base / f"numba-{compiling._digest()}"
    assert (float(value), int(files)) == (1.0, 1)


def test_the_first_folder_that_can_be_written_is_taken(unwritable, tmp_path):
    folder, _, files = run(REPORT, **unwritable | {"NUMBA_CACHE_DIR": tmp_path / "second"})
    assert Path(folder).parent == tmp_path / "second"
    assert int(files) == 1


def test_where_nothing_can_be_written_a_passing_folder_serves_and_goes(unwritable):
    folder, value, files = run(REPORT, **unwritable)
    assert unwritable["TMPDIR"] in Path(folder).parents
    assert (float(value), int(files)) == (1.0, 1)
    assert list(unwritable["TMPDIR"].iterdir()) == []


def test_a_worker_process_shares_the_passing_folder_of_its_parent(unwritable):
    parent, child = run(WITH_A_CHILD, **unwritable)
    assert child == parent
