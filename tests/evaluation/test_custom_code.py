"""Custom policies that are evaluated do what their files hold now, whatever the process has imported."""

from __future__ import annotations

import importlib
import os
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from helpers.versions import POLICY, constant, evaluated

import ibdata
from ibdata.experiment import Experiment


def test_policies_in_two_folders_with_modules_of_one_name_do_not_meet(version):
    one, two = version("one", 0.0), version("two", 1.0)
    expected = [constant(0.0), constant(1.0), constant(0.0)]
    np.testing.assert_array_equal(evaluated(one, two, one), expected)


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


def test_an_object_beside_a_block_is_played_as_it_is(version, monkeypatch):
    path = version("two", 1.0)
    monkeypatch.syspath_prepend(path.parent)
    module = importlib.import_module("own_two")
    monkeypatch.setattr(importlib.import_module("size_of_version"), "SIZE", -1.0)
    returns = evaluated(path, module.Own(), path)
    np.testing.assert_array_equal(returns, [constant(1.0), constant(-1.0), constant(1.0)])


def test_a_policy_that_goes_to_another_folder_is_looked_for_in_the_first(version, tmp_path, monkeypatch):
    path = version("two", 1.0)
    monkeypatch.chdir(path.parent)
    code = POLICY.replace("class Own:", "class Own:\n    def __init__(self): os.chdir('/')\n")
    path.with_name("own_two.py").write_text(f"import os\n{code}")
    np.testing.assert_array_equal(evaluated({"kind": "custom", "target": "own_two.py:Own"})[0], constant(1.0))
    assert path.parent.samefile(".")


def test_code_is_looked_for_in_the_first_folder_if_an_object_goes_to_another(version, tmp_path, monkeypatch):
    class Gone:
        def predict(self, observations):
            os.chdir(tmp_path)
            return np.zeros((len(observations), 3))

    monkeypatch.chdir(version("two", 1.0).parent)
    returns = evaluated(Gone(), {"kind": "custom", "target": "own_two.py:Own"})
    np.testing.assert_array_equal(returns[1], constant(1.0))


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
