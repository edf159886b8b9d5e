"""Custom policies that are evaluated: a process imports each of their modules once, and never another one."""

from __future__ import annotations

import importlib
import sys

import numpy as np
import pytest

import ibdata
from ibdata.errors import UsageError
from ibdata.experiment import code_record
from ibdata.policies.custom import Custom

TARGET = "own_two.py:Own"
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


def test_a_module_of_another_folder_that_is_imported_while_a_policy_plays_is_refused(version, tmp_path):
    one, two = version("one", 0.0), version("two", 1.0)
    (tmp_path / "two/own_two.py").write_text(POLICY.replace("from size_of_version import SIZE", "SIZE = 1.0"))
    with pytest.raises(UsageError, match=r"one/size_of_version\.py: .*two/size_of_version\.py; rename"):
        evaluated(one, two)


def test_a_policy_of_an_experiment_is_looked_for_in_the_current_folder_and_compared(version, monkeypatch):
    for path in (version("one", 0.0), version("two", 1.0)):
        monkeypatch.chdir(path.parent)
        policy = Custom(target=f"own_{path.parent.name}.py:Own")
        if path.parent.name == "one":
            evaluated(policy)
    with pytest.raises(UsageError, match=r"two/size_of_version\.py: .*one/size_of_version\.py; rename"):
        evaluated(policy)


def test_a_module_that_a_policy_finds_in_a_folder_of_its_own_is_compared_too(version, tmp_path):
    for name, size in (("one", 0.0), ("two", 1.0)):
        version(name, size)
        folder = tmp_path / name
        (folder / "lib").mkdir()
        (folder / "size_of_version.py").rename(folder / "lib/size_of_version.py")
        (folder / f"own_{name}.py").write_text(
            "import os, sys\nsys.path.insert(0, os.path.join(os.path.dirname(__file__), 'lib'))\n"
            f"import size_of_version\n{POLICY}"
        )
    evaluated(tmp_path / "one/own.yaml")
    with pytest.raises(UsageError, match=r"two/lib/size_of_version\.py: .*one/lib/size_of_version\.py; ren"):
        evaluated(tmp_path / "two/own.yaml")


def test_a_run_between_evaluations_does_not_hide_an_edit(version, tmp_path, monkeypatch):
    path = version("two", 1.0)
    evaluated(path)
    (tmp_path / "two/size_of_version.py").write_text("SIZE = -1.0\n")
    monkeypatch.chdir(tmp_path / "two")
    plain = {"name": "x", "setpoints": 70, "steps": 3, "policies": [{"kind": "custom", "target": TARGET}]}
    made = ibdata.generate(plain, tmp_path / "data", workers=1, allow_code=True)
    assert set(np.unique(made.arrays()["actions"])) == {-1.0}
    with pytest.raises(UsageError, match=r"size_of_version\.py: was changed after .*; start Python again"):
        evaluated(path)


@pytest.mark.parametrize("keeps", [True, False])
def test_an_edit_of_what_the_script_had_imported_is_seen_in_the_bytecode(
    version, tmp_path, monkeypatch, keeps
):
    path = version("two", 1.0)
    monkeypatch.syspath_prepend(path.parent)
    monkeypatch.setattr(sys, "dont_write_bytecode", not keeps)
    importlib.import_module("size_of_version")
    (tmp_path / "two/size_of_version.py").write_text("SIZE = -0.5\n")
    if keeps:
        with pytest.raises(
            UsageError, match=r"size_of_version\.py: was changed after .*; start Python again"
        ):
            evaluated(path)
    else:
        evaluated(path)  # nothing tells


def test_a_file_that_was_edited_after_it_was_imported_is_refused(version, tmp_path):
    path = version("two", 1.0)
    evaluated(path)
    (tmp_path / "two/own_two.py").write_text(POLICY.replace("SIZE)", "-SIZE)"))
    with pytest.raises(UsageError, match=r"own_two\.py: was changed after .*; start Python again"):
        evaluated(path)
