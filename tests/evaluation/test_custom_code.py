"""Custom policies that are evaluated: a process imports each of their modules once, and never another one."""

from __future__ import annotations

import sys

import pytest

import ibdata
from ibdata.errors import UsageError
from ibdata.experiment import code_record

POLICY = """
import numpy as np

def act(history, u):
    from size_of_version import SIZE
    return np.full((len(history), 3), SIZE)

class Own:
    def act(self, history, u):
        return act(history, u)
"""


@pytest.fixture
def version(tmp_path, monkeypatch):
    """`version(name, size)` writes a policy and its helper into a folder and returns the path of the YAML."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(code_record, "_loaded_once", {})

    def written(name, size):
        folder = tmp_path / name
        folder.mkdir()
        (folder / f"own_{name}.py").write_text(POLICY)
        (folder / "size_of_version.py").write_text(f"SIZE = {size}\n")
        (folder / "own.yaml").write_text(f"kind: custom\ntarget: own_{name}.py:Own\n")
        return folder / "own.yaml"

    yield written
    for module in ("size_of_version", "own_one", "own_two"):
        sys.modules.pop(module, None)


def evaluated(*policies):
    return ibdata.evaluate(list(policies), allow_code=True, episodes=3, steps=4, setpoint=70)


def test_two_folders_with_a_module_of_one_name_are_refused_however_late_it_is_imported(version):
    one, two = version("one", 0.0), version("two", 1.0)
    with pytest.raises(
        UsageError, match=r"two/size_of_version\.py: found another module with the name size_"
    ):
        evaluated(one, two)
    assert evaluated(one, one).returns.shape[0] == 2
    with pytest.raises(UsageError, match=r"two/size_of_version\.py: .*one/size_of_version\.py; rename"):
        evaluated(two)


def test_a_file_that_was_edited_after_it_was_imported_is_refused(version, tmp_path):
    path = version("two", 1.0)
    evaluated(path)
    (tmp_path / "two/own_two.py").write_text(POLICY.replace("SIZE)", "-SIZE)"))
    with pytest.raises(UsageError, match=r"own_two\.py: was changed after .*; start Python again"):
        evaluated(path)
