"""Custom policies that are evaluated do what their files hold now, whatever the process has imported."""

from __future__ import annotations

import importlib
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import ibdata
from ibdata.errors import UsageError
from ibdata.experiment import Experiment, fresh_modules

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
    monkeypatch.setattr(fresh_modules, "imported_by_policies", {})

    def written(name, size):
        folder = tmp_path / name
        folder.mkdir(exist_ok=True)
        (folder / f"own_{name}.py").write_text(POLICY)
        (folder / "size_of_version.py").write_text(f"SIZE = {size}\n")
        (folder / "own.yaml").write_text(f"kind: custom\ntarget: own_{name}.py:Own\n")
        return folder / "own.yaml"

    yield written
    for module in ("size_of_version", "own_one", "own_two"):
        sys.modules.pop(module, None)


def evaluated(*policies):
    return ibdata.evaluate(list(policies), allow_code=True, episodes=3, steps=4, setpoint=70).returns[:, 0]


def constant(size):
    """The returns of a policy that always takes one action."""
    return evaluated({"kind": "constant", "action": [size] * 3})[0]


def test_two_folders_with_a_module_of_one_name_are_refused_in_one_evaluation_only(version):
    one, two = version("one", 0.0), version("two", 1.0)
    with pytest.raises(
        UsageError, match=r"two/size_of_version\.py: found another module with the name size_.*; rename one"
    ):
        evaluated(one, two)
    np.testing.assert_array_equal(evaluated(one, one), [constant(0.0)] * 2)
    np.testing.assert_array_equal(evaluated(two)[0], constant(1.0))


def test_a_module_of_another_folder_that_is_imported_while_a_policy_plays_is_refused(version, tmp_path):
    one, two = version("one", 0.0), version("two", 1.0)
    (tmp_path / "two/own_two.py").write_text(POLICY.replace("from size_of_version import SIZE", "SIZE = 1.0"))
    with pytest.raises(UsageError, match=r"one/size_of_version\.py: .*two/size_of_version\.py; rename"):
        evaluated(one, two)


def imported_by_the_script(folder, monkeypatch):
    monkeypatch.syspath_prepend(folder)
    return importlib.import_module("size_of_version")


def imported_with_bytecode_of_now(folder, monkeypatch):
    """As if a terminal had imported the module after the edit."""
    monkeypatch.syspath_prepend(folder)
    module = importlib.import_module("size_of_version")
    (folder / "size_of_version.py").write_text("SIZE = -1.0\n")
    subprocess.run([sys.executable, "-c", "import size_of_version"], cwd=folder, check=True)
    return module


def never_imported(folder, monkeypatch):
    return None


@pytest.mark.parametrize("way", [never_imported, imported_by_the_script, imported_with_bytecode_of_now])
def test_an_edit_counts_at_once_and_the_modules_of_the_script_stay(version, tmp_path, monkeypatch, way):
    path = version("two", 1.0)
    module = way(tmp_path / "two", monkeypatch)
    for size in (1.0, -1.0, 0.5):
        version("two", size)
        np.testing.assert_array_equal(evaluated(path)[0], constant(size))
        assert sys.modules.get("size_of_version") is module


def test_an_edit_of_a_module_that_no_source_names_counts_too(version, tmp_path, monkeypatch):
    path = version("two", 1.0)
    monkeypatch.chdir(path.parent)
    code = POLICY.replace("from size_of", "import importlib; SIZE = importlib.import_module('size_' + 'of")
    path.with_name("own_two.py").write_text(code.replace("_version import SIZE", "_version').SIZE"))
    for size in (1.0, -1.0):
        path.with_name("size_of_version.py").write_text(f"SIZE = {size}\n")
        np.testing.assert_array_equal(evaluated(path)[0], constant(size))


def test_an_edit_of_the_module_of_a_stored_object_counts_too(version, tmp_path, monkeypatch):
    path = version("two", 1.0)
    monkeypatch.syspath_prepend(path.parent)
    own = importlib.import_module("own_two").Own()
    path.with_name("own.bin").write_bytes(pickle.dumps(own))
    path.with_name("loads.py").write_text(
        "import pickle, pathlib\n"
        "def P(): return pickle.loads(pathlib.Path(__file__).with_name('own.bin').read_bytes())\n"
    )
    path.write_text("kind: custom\ntarget: loads.py:P\nfiles: [own.bin]\n")
    for sign in (1.0, -1.0):
        path.with_name("own_two.py").write_text(POLICY.replace("SIZE)", f"{sign} * SIZE)"))
        np.testing.assert_array_equal(evaluated(path)[0], constant(sign))


def test_a_policy_of_an_experiment_reads_its_files_anew(version, monkeypatch):
    path = version("two", 1.0)
    monkeypatch.chdir(path.parent)
    path.with_name("own_two.py").write_text(
        "import numpy as np\nclass Own:\n    def __init__(self): self.size = np.load('size.npy')\n"
        "    def predict(self, observations): return np.full((len(observations), 3), self.size)\n"
    )
    block = {"kind": "custom", "target": "own_two.py:Own", "files": ["size.npy"]}
    blocks = [block, {"kind": "gaussian", "base": {**block, "deterministic": True}, "scale": 1e-9}]
    experiment = Experiment.model_validate({"name": "x", "setpoints": 70, "steps": 3, "policies": blocks})
    for size in (1.0, -1.0):
        np.save("size.npy", size)
        for policy in experiment.policies:
            np.testing.assert_array_equal(evaluated(policy)[0], constant(size))


def test_a_run_between_evaluations_changes_nothing(version, monkeypatch):
    path = version("two", 1.0)
    monkeypatch.chdir(path.parent)
    policy = {"kind": "custom", "target": "own_two.py:Own"}
    plain = {"name": "x", "setpoints": 70, "steps": 3, "policies": [policy]}
    for size in (1.0, -1.0):
        version("two", size)
        made = ibdata.generate(plain, f"data{size}", workers=1, allow_code=True)
        assert set(np.unique(made.arrays()["actions"])) == {size}
        np.testing.assert_array_equal(evaluated(path)[0], constant(size))


def test_evaluations_in_threads_wait_for_each_other(version):
    paths = [version("one", 0.0), version("two", 1.0)] * 4
    with ThreadPoolExecutor(4) as pool:
        for returns, path in zip(pool.map(evaluated, paths), paths, strict=True):
            np.testing.assert_array_equal(returns[0], constant(float(path.parent.name == "two")))


def test_the_path_of_python_and_the_current_folder_stay(version, tmp_path, monkeypatch):
    path = version("two", 1.0)
    path.with_name("own_two.py").write_text(f"import os, sys\nos.chdir('/')\nsys.path.append('x')\n{POLICY}")
    monkeypatch.chdir(tmp_path)
    before = list(sys.path)
    evaluated(path)
    assert (sys.path, tmp_path.samefile(".")) == (before, True)
