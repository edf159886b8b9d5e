"""Packages, bytecode and modules with names of Python's, of custom policies that are evaluated."""

from __future__ import annotations

import importlib
import os
import sys

import numpy as np
import pytest
from helpers.versions import POLICY, constant, evaluated

from ibdata.errors import UsageError


@pytest.mark.parametrize("is_package", [False, True])
def test_a_package_that_the_script_has_imported_keeps_no_old_module(version, monkeypatch, is_package):
    path = version("two", 1.0)
    monkeypatch.chdir(path.parent)
    monkeypatch.syspath_prepend(path.parent)
    package = path.with_name("sized")
    package.mkdir()
    if is_package:
        (package / "__init__.py").write_text("")
    (package / "size_of_version.py").write_text("SIZE = 1.0\n")
    code = POLICY.replace(
        "from size_of_version import SIZE", "from . import size_of_version as own; SIZE = own.SIZE"
    )
    (package / "own_two.py").write_text(code)
    path.with_name("own_two.py").write_text(
        "import importlib\ndef Own(): return importlib.import_module('sized' + '.own_two').Own()\n"
    )
    module = importlib.import_module("sized.size_of_version")
    try:
        for size in (1.0, -1.0):
            (package / "size_of_version.py").write_text(f"SIZE = {size}\n")
            np.testing.assert_array_equal(evaluated(path)[0], constant(size))
            assert sys.modules["sized"].size_of_version is sys.modules["sized.size_of_version"] is module
        assert "sized.own_two" not in sys.modules
    finally:
        for name in ("sized", "sized.size_of_version"):
            del sys.modules[name]


def test_a_package_that_only_a_policy_imported_is_gone_afterwards(version, monkeypatch):
    path = version("two", 1.0)
    (path.parent / "sized").mkdir()
    path.with_name("size_of_version.py").rename(path.parent / "sized/size_of_version.py")
    path.with_name("own_two.py").write_text(POLICY.replace("from size", "from sized.size"))
    evaluated(path)
    assert not [name for name in sys.modules if name.startswith("sized")]


EXECUTED = """
import importlib.util, pathlib
import numpy as np

class Own:
    def __init__(self):
        path = pathlib.Path(__file__).with_name("size_of_version.py")
        spec = importlib.util.spec_from_file_location("executed", path)
        self.own = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(self.own)

    def predict(self, observations):
        return np.full((len(observations), 3), self.own.SIZE)
"""


def test_a_declared_file_that_is_executed_is_not_taken_from_bytecode_of_another(version, monkeypatch):
    """The time and the size of the file stay, so Python takes its bytecode for right."""
    path = version("two", 1.0)
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    path.with_name("own_two.py").write_text(EXECUTED)
    path.write_text("kind: custom\ntarget: own_two.py:Own\nfiles: [size_of_version.py]\n")
    for size in ("0.25", "0.75"):
        path.with_name("size_of_version.py").write_text(f"SIZE = {size}\n")
        os.utime(path.with_name("size_of_version.py"), (10**9, 10**9))
        np.testing.assert_array_equal(evaluated(path)[0], constant(float(size)))


def test_late_bytecode_of_another_file_is_refused_once(version, monkeypatch):
    """Nobody knows the name of the module before it is imported."""
    path = version("two", 1.0)
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.syspath_prepend(path.parent)
    late = POLICY.replace("from size_of", "import importlib; SIZE = importlib.import_module('size_' + 'of")
    path.with_name("own_two.py").write_text(late.replace("_version import SIZE", "_version').SIZE"))
    helper = path.with_name("size_of_version.py")
    for size in ("0.25", "0.75"):
        helper.write_text(f"SIZE = {size}\n")
        os.utime(helper, (10**9, 10**9))
        if size == "0.25":
            importlib.import_module("size_of_version")
    with pytest.raises(
        UsageError, match=r"size_of_version\.py: its bytecode was that of other code, .* run again"
    ):
        evaluated(path)
    np.testing.assert_array_equal(evaluated(path)[0], constant(0.75))


def test_a_policy_of_ibdata_is_played_whatever_the_script_has_imported(version, monkeypatch):
    path = version("two", 1.0)
    evaluated(path)
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.syspath_prepend(path.parent)
    helper = path.with_name("size_of_version.py")
    for size in ("0.25", "0.75"):
        helper.write_text(f"SIZE = {size}\n")
        os.utime(helper, (10**9, 10**9))
        importlib.import_module("size_of_version")  # once, so its bytecode is that of the first
    assert evaluated("safe").shape == (1, 3)


def test_a_module_with_the_name_of_one_of_python_is_imported_anew_too(version, monkeypatch):
    path = version("two", 1.0)
    monkeypatch.syspath_prepend(path.parent)
    monkeypatch.delitem(sys.modules, "sched", raising=False)
    path.with_name("own_two.py").write_text(POLICY.replace("size_of_version", "sched"))
    for size in (1.0, -1.0):
        path.with_name("sched.py").write_text(f"SIZE = {size}\n")
        module = importlib.import_module("sched")
        np.testing.assert_array_equal(evaluated(path)[0], constant(size))
        assert sys.modules["sched"] is module
    del sys.modules["sched"]
