"""Custom policies that are evaluated do what their files hold now, whatever the process has imported."""

from __future__ import annotations

import importlib
import os
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

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


NAMES_ITSELF = """
import ibdata
{policy}
own = {{"kind": "custom", "target": "train.py:Own"}}
plain = {{"name": "x", "setpoints": 70, "episodes": 2, "steps": 3, "policies": [own]}}
ibdata.{call}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "call", ["generate(plain, 'out', workers=2, allow_code=True)", "evaluate(own, 70, episodes=2, steps=3)"]
)
def test_a_script_that_names_itself_as_the_policy_is_told_so(tmp_path, call):
    (tmp_path / "train.py").write_text(NAMES_ITSELF.format(policy=POLICY, call=call))
    child = subprocess.run(
        [sys.executable, "train.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(Path(ibdata.__file__).parents[1])},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert "UsageError: train.py:Own: calls ibdata with itself as a policy while" in child.stderr
    assert len(child.stderr.splitlines()) < 100
    assert not (tmp_path / "out").exists()


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
