"""The cache of compiled functions: a folder named after their sources."""

from __future__ import annotations

import ast
import hashlib
import os
import pickle
import re
import resource
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import FunctionType

import numba
import pytest
from numba.core.dispatcher import Dispatcher

from ibdata.numerics import compiled
from ibdata.system.cache_folders import PASSING

pytestmark = pytest.mark.slow

PACKAGE = compiled.PACKAGE

REPORT = """
import os
from ibdata.numerics.compiled import PLACES
from ibdata.dynamics.steering import clip
print(PLACES.folders[0])
print(clip(7.0, 0.0, 1.0))
print(sum(name.endswith(".nbc") for name in os.listdir(PLACES.folders[0])))
print(sum(clip.stats.cache_misses.values()) if hasattr(clip, "stats") else 0)
"""
WITH_A_CHILD = """
import subprocess, sys
from ibdata.numerics.compiled import PLACES
child = "import ibdata.numerics.compiled; print(*ibdata.numerics.compiled.PLACES.folders)"
print(*PLACES.folders)
print(subprocess.run([sys.executable, "-c", child], capture_output=True, text=True, check=True).stdout)
"""


def covered():
    return {path for pattern in compiled.SOURCES for path in PACKAGE.glob(pattern)}


def compiled_files():
    """The files that decorate a function with `compiled`."""

    def decorates(node):
        return isinstance(node, ast.FunctionDef) and "compiled" in map(ast.unparse, node.decorator_list)

    return [
        path for path in PACKAGE.rglob("*.py") if any(map(decorates, ast.walk(ast.parse(path.read_text()))))
    ]


def run(script, limit=None, **variables):
    """The words that a child prints which has these variables for its folders, and no others.

    The limit is that of the size of the files it writes.
    """
    others = ("IBDATA_CACHE_DIR", "NUMBA_CACHE_DIR", PASSING)
    env = {k: v for k, v in os.environ.items() if k not in others}
    env |= {"PYTHONPATH": str(PACKAGE.parent), "NUMBA_DISABLE_JIT": "0"}
    child = subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        env=env | {name: str(value) for name, value in variables.items()},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        preexec_fn=limit and (lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))),
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
    monkeypatch.setattr(compiled, "PACKAGE", folder)
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
    assert [pattern for pattern in compiled.SOURCES if not list(PACKAGE.glob(pattern))] == []


def test_a_change_in_any_covered_file_changes_the_digest(copy):
    digests = {compiled._digest()}
    paths = sorted(covered())
    for path in paths:
        with (copy / path.relative_to(PACKAGE)).open("a") as file:
            file.write("# changed\n")
        digests.add(compiled._digest())
    assert len(digests) == len(paths) + 1


def test_a_new_policy_file_changes_the_digest(copy):
    before = compiled._digest()
    (copy / "policies" / "ramp.py").write_text("# a policy\n")
    assert compiled._digest() != before


def test_a_copy_has_the_same_digest_and_a_change_elsewhere_leaves_it(copy, monkeypatch):
    before = compiled._digest()
    (copy / "version.py").write_text('__version__ = "99"\n')
    assert compiled._digest() == before
    monkeypatch.setattr(compiled, "PACKAGE", PACKAGE)
    assert compiled._digest() == before


def test_another_version_of_the_compiler_changes_the_digest(monkeypatch):
    before = compiled._digest()
    monkeypatch.setattr(numba, "__version__", "0.0.0")
    assert compiled._digest() != before


def test_the_folder_is_named_by_the_digest():
    assert re.fullmatch(r"numba-[0-9a-f]{16}", compiled.PLACES.name)
    assert compiled.PLACES.name == f"numba-{compiled._digest()}"
    assert {Path(folder).name for folder in compiled.PLACES.folders} == {compiled.PLACES.name}


@pytest.mark.parametrize("variable", ["IBDATA_CACHE_DIR", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME"])
def test_each_variable_can_say_where_the_code_is_kept(variable, tmp_path):
    folder, value, files, _ = run(REPORT, **{variable: tmp_path / "asked"})
    base = tmp_path / "asked" / "ibdata" if variable == "XDG_CACHE_HOME" else tmp_path / "asked"
    assert Path(folder) == base / f"numba-{compiled._digest()}"
    assert (float(value), int(files)) == (1.0, 1)


def test_the_first_folder_that_can_be_written_is_taken(unwritable, tmp_path):
    folder, _, files, _ = run(REPORT, **unwritable | {"NUMBA_CACHE_DIR": tmp_path / "second"})
    assert Path(folder).parent == tmp_path / "second"
    assert int(files) == 1


def test_where_nothing_can_be_written_a_temporary_folder_is_used_and_removed(unwritable):
    folder, value, files, _ = run(REPORT, **unwritable)
    assert unwritable["TMPDIR"] in Path(folder).parents
    assert (float(value), int(files)) == (1.0, 1)
    assert list(unwritable["TMPDIR"].iterdir()) == []


def test_a_worker_process_shares_the_temporary_folder_of_its_parent(unwritable):
    parent, child = run(WITH_A_CHILD, **unwritable)
    assert child == parent


@pytest.fixture
def code(tmp_path):
    """A folder with the machine code of one function."""
    assert run(REPORT, IBDATA_CACHE_DIR=tmp_path / "code")[1:] == ["1.0", "1", "1"]
    return tmp_path / "code"


def code_files(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_a_second_process_compiles_nothing_and_writes_nothing(code):
    before = [(path, path.stat().st_ino) for path in code_files(code)]
    assert run(REPORT, IBDATA_CACHE_DIR=code)[1:] == ["1.0", "1", "0"]
    assert [(path, path.stat().st_ino) for path in code_files(code)] == before


@pytest.mark.parametrize("damage", ["empty", "cut off", "first bit", "middle bit", "last bit"])
def test_damaged_machine_code_is_compiled_again(code, damage):
    """A flipped bit would otherwise be run."""
    whole = {path: path.read_bytes() for path in code_files(code)}
    for path, good in whole.items():
        place = {"first bit": 0, "middle bit": len(good) // 2, "last bit": len(good) - 1}.get(damage)
        bad = good[: 0 if damage == "empty" else len(good) // 2]
        if place is not None:
            bad = good[:place] + bytes([good[place] ^ 1]) + good[place + 1 :]
        path.write_bytes(bad)
    assert run(REPORT, IBDATA_CACHE_DIR=code)[1:] == ["1.0", "1", "1"]
    assert run(REPORT, IBDATA_CACHE_DIR=code)[1:] == ["1.0", "1", "0"]


class Planted:
    """What runs a command where it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def plant(code, run_by):
    for path in code_files(code):
        content = pickle.dumps(Planted(run_by))
        path.write_bytes(hashlib.sha256(content).digest() + content)


def test_the_planted_code_would_run(code, tmp_path):
    """Else the next test shows nothing."""
    plant(code, tmp_path / "ran")
    run(REPORT, IBDATA_CACHE_DIR=code)
    assert (tmp_path / "ran").exists()


@pytest.mark.parametrize("open_to_all", ["file", "folder", "base"])
def test_code_that_others_may_have_planted_is_not_run(code, tmp_path, open_to_all):
    plant(code, tmp_path / "ran")
    [file] = code_files(code)
    {"file": file, "folder": file.parent, "base": code}[open_to_all].chmod(0o777)
    value = run(REPORT, IBDATA_CACHE_DIR=code, XDG_CACHE_HOME=tmp_path / "own")[1]
    assert (value, (tmp_path / "ran").exists()) == ("1.0", False)


def test_where_no_file_can_grow_functions_are_compiled_and_not_kept(tmp_path):
    (tmp_path / "tmp").mkdir()
    words = run(REPORT, limit=1000, IBDATA_CACHE_DIR=tmp_path / "code", TMPDIR=tmp_path / "tmp")
    assert words[1:] == ["1.0", "0", "1"]
    assert list((tmp_path / "tmp").iterdir()) == code_files(tmp_path / "code") == []


def test_nothing_is_kept_where_nothing_is_compiled(tmp_path):
    words = run(REPORT, NUMBA_DISABLE_JIT=1, IBDATA_CACHE_DIR=tmp_path / "code")
    assert words[1:] == ["1.0", "0", "0"]


def test_a_dataset_is_checked_where_the_cache_is_full(ibdata, tmp_path):
    (tmp_path / "tiny.yaml").write_text("name: tiny\nsetpoints: 70\npolicies: [{kind: random}]\nsteps: 10\n")
    assert ibdata("generate", "--config", "tiny.yaml", "--out", "tiny").returncode == 0
    full = {**os.environ, "IBDATA_CACHE_DIR": str(tmp_path / "code")}
    script = "import resource, ibdata.cli as c; resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0)); c.main()"
    args = [sys.executable, "-c", script, "validate", "tiny"]
    checked = subprocess.run(args, cwd=tmp_path, env=full, capture_output=True, text=True, timeout=300)
    assert (checked.returncode, checked.stdout) == (0, "tiny: valid\n")
    assert [line[:17] for line in checked.stderr.splitlines()] == ["ibdata: compiling"]


def test_code_that_is_not_kept_is_announced_as_such(command, unwritable, tmp_path):
    (tmp_path / "tiny.yaml").write_text("name: tiny\nsetpoints: 70\npolicies: [{kind: random}]\nsteps: 10\n")
    env = {**os.environ, **{name: str(value) for name, value in unwritable.items()}}
    words = [command, "generate", "--config", "tiny.yaml", "--out", "tiny", "-q"]
    made = subprocess.run(words, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=300)
    assert made.returncode == 0
    assert "no cache folder that only this user can write to; set IBDATA_CACHE_DIR" in made.stderr


def test_a_setting_that_numba_refuses_is_one_line(ibdata):
    refused = ibdata("validate", ".", env={**os.environ, "NUMBA_NUM_THREADS": "0"})
    assert refused.returncode == 2
    assert re.fullmatch(
        r"NUMBA_\w+(, NUMBA_\w+)*: numba refuses .*threads.* Correct or unset it\.\n", refused.stderr
    )
