"""Custom policies that are evaluated: their modules are those that Python has, or finds."""

from __future__ import annotations

import importlib
import pickle
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from helpers.versions import POLICY, constant, evaluated

import ibdata
from ibdata.errors import UsageError
from ibdata.experiment import Experiment


def test_helpers_of_one_name_in_two_folders_are_refused(version):
    one, two = version("one", 0.0), version("two", 1.0)
    np.testing.assert_array_equal(evaluated(one)[0], constant(0.0))
    line = r"two/size_of_version\.py: found another module with the name size_of_version in use, .*/one/"
    with pytest.raises(UsageError, match=line):
        evaluated(two)


def test_an_edit_of_the_file_that_is_named_counts_at_once(version):
    path = version("two", 1.0)
    for sign in (1.0, -1.0, 1.0):
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


def test_an_object_is_played_as_it_is_and_a_block_has_the_modules_of_the_session(version, monkeypatch):
    path = version("two", 1.0)
    monkeypatch.syspath_prepend(path.parent)
    module = importlib.import_module("own_two")
    monkeypatch.setattr(importlib.import_module("size_of_version"), "SIZE", -1.0)
    np.testing.assert_array_equal(evaluated(path, module.Own()), [constant(-1.0)] * 2)


def test_a_run_between_evaluations_changes_nothing(version, monkeypatch):
    path = version("two", 1.0)
    monkeypatch.chdir(path.parent)
    policy = {"kind": "custom", "target": "own_two.py:Own"}
    plain = {"name": "x", "setpoints": 70, "steps": 3, "policies": [policy]}
    np.testing.assert_array_equal(evaluated(path)[0], constant(1.0))
    version("two", -1.0)
    made = ibdata.generate(plain, "data", workers=1, allow_code=True)
    assert set(np.unique(made.arrays()["actions"])) == {-1.0}
    np.testing.assert_array_equal(evaluated(path)[0], constant(1.0))


def test_evaluations_run_in_threads(version):
    path = version("two", 1.0)
    with ThreadPoolExecutor(4) as pool:
        for returns in pool.map(evaluated, [path] * 8):
            np.testing.assert_array_equal(returns[0], constant(1.0))


@pytest.mark.slow
def test_background_threads_of_the_session_go_on_working(version, monkeypatch):
    """They pickle an object of the policy's class, and import its module, while ibdata runs that class."""
    path = version("two", 1.0)
    monkeypatch.chdir(path.parent)
    monkeypatch.syspath_prepend(path.parent)
    own, errors, tries, done = importlib.import_module("own_two").Own(), [], [], threading.Event()

    def work():
        while not done.is_set():
            try:
                assert type(pickle.loads(pickle.dumps(own))) is type(own)
                assert importlib.import_module("own_two").Own is type(own)
            except Exception as error:
                errors.append(error)
            tries.append(0)

    policy = {"kind": "custom", "target": "own_two:Own"}
    thread = threading.Thread(target=work)
    thread.start()
    try:
        plain = {"name": "x", "setpoints": 70, "steps": 3, "policies": [policy]}
        ds = ibdata.generate(plain, "data", allow_code=True)
        assert ibdata.reproduce("data", allow_code=True) == (1, [])
        evaluated(policy, path)
    finally:
        done.set()
        thread.join()
    assert len(ds) == 3
    assert len(tries) > 100
    assert errors == []


def test_the_path_of_python_stays(version):
    path = version("two", 1.0)
    before = list(sys.path)
    evaluated(path)
    assert sys.path == before
