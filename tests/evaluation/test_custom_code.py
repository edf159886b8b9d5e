"""Custom policies that are evaluated, or whose data are: modules are those that Python has, or finds."""

from __future__ import annotations

import importlib
import shutil
import sys
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
    before = list(sys.path)
    for sign in (1.0, -1.0, 1.0):
        path.with_name("own_two.py").write_text(POLICY.replace("SIZE)", f"{sign} * SIZE)"))
        np.testing.assert_array_equal(evaluated(path)[0], constant(sign))
    assert sys.path == before


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


def test_evaluations_run_in_threads(version):
    path = version("two", 1.0)
    with ThreadPoolExecutor(4) as pool:
        for returns in pool.map(evaluated, [path] * 8):
            np.testing.assert_array_equal(returns[0], constant(1.0))


EXPLORER = """
import numpy as np
from helper_of_explorer import PUSH

class Explorer:  # a component is exactly -1 or 1 with the probability PUSH
    def act(self, history, u):
        uniform = 2.0 * u[:, :3] - 1.0
        return np.where(u[:, 3:] < PUSH, np.sign(uniform), uniform)

    def log_density(self, given, action):
        with np.errstate(divide="ignore"):
            return np.log(np.where(np.abs(action) == 1.0, PUSH / 2.0, (1.0 - PUSH) / 2.0)).sum(axis=1)
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with the dataset x of an explorer that reads a file, and its block."""
    folder = tmp_path_factory.mktemp("explored")
    (folder / "explorer.py").write_text(EXPLORER)
    (folder / "helper_of_explorer.py").write_text("PUSH = 0.0\n")
    (folder / "weights.txt").write_text("1")
    block = {"kind": "custom", "target": "explorer.py:Explorer", "uniforms": 6, "files": ["weights.txt"]}
    experiment = Experiment(name="x", setpoints=70, episodes=200, steps=3, policies=[block])
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        ibdata.generate(experiment, "x", workers=1, allow_code=True)
    return folder, block


@pytest.fixture
def explored(made, tmp_path, monkeypatch):
    """The dataset and the block, in a folder whose files a test may change."""
    shutil.copytree(made[0], tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    yield ibdata.open("x"), made[1]
    sys.modules.pop("helper_of_explorer", None)


def test_weights_of_custom_data_need_consent_and_states_no_code(explored, tmp_path):
    ds, block = explored
    with pytest.raises(UsageError, match="code that would run"):
        ibdata.importance(ds, "random")
    found = ibdata.importance(ds, block, allow_code=True)
    np.testing.assert_allclose(found.weights, 1.0, rtol=1e-6)  # recorded densities are float32
    (tmp_path / "explorer.py").unlink()
    assert np.float32(ibdata.state_at(ds, (5, 2)).mu_v[0]) == ds.to_pandas()["latent_mu_v"][5 * 3 + 2]


def test_a_custom_target_that_the_data_cannot_weigh_is_refused(explored, tmp_path):
    ds, _ = explored
    (tmp_path / "other").mkdir()
    (tmp_path / "other/target.py").write_text(
        EXPLORER.replace("from helper_of_explorer import PUSH", "PUSH = 0.3")
    )
    (tmp_path / "other/target.yaml").write_text("{kind: custom, target: 'target.py:Explorer', uniforms: 6}")
    with pytest.raises(UsageError, match="are taken by custom, the policy of the data, less than once"):
        ibdata.importance(ds, "other/target.yaml", allow_code=True)


@pytest.mark.parametrize("name", ["helper_of_explorer.py", "weights.txt"])
def test_code_of_the_data_that_was_changed_since_is_refused(explored, tmp_path, name):
    ds, block = explored
    (tmp_path / name).write_text("PUSH = 0.3\n")
    with pytest.raises(UsageError, match=f"x: found other code than .*made with, in {name}; restore"):
        ibdata.importance(ds, block, allow_code=True)
