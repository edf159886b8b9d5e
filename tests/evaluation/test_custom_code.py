"""Data of custom policies: their code is asked for densities, where it may run and is what it was."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

import ibdata
from ibdata.errors import UsageError
from ibdata.experiment import Experiment

EXPLORER = """
import numpy as np
from helper_of_explorer import PUSH
from ibdata.policies import Decision, Distribution, Needs

class Pushed(Distribution):  # a component is exactly -1 or 1 with the probability PUSH
    draws = 6

    def sample(self, u):
        uniform = 2.0 * u[:, :3] - 1.0
        return np.where(u[:, 3:] < PUSH, np.sign(uniform), uniform)

    def log_density(self, action):
        with np.errstate(divide="ignore"):
            return np.log(np.where(np.abs(action) == 1.0, PUSH / 2.0, (1.0 - PUSH) / 2.0)).sum(axis=1)

class Explorer:
    needs = Needs(draws=6)

    def decide(self, observed):
        return Decision(Pushed(), observed.memory)
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with the dataset x of an explorer, and its block."""
    folder = tmp_path_factory.mktemp("explored")
    (folder / "explorer.py").write_text(EXPLORER)
    (folder / "helper_of_explorer.py").write_text("PUSH = 0.0\n")
    block = {"kind": "custom", "target": "explorer.py:Explorer", "draws": 6}
    experiment = Experiment(name="x", setpoints=70, episodes=20, steps=3, policies=[block])
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        ibdata.generate(experiment, "x", workers=1, allow_code=True)
    return folder, block


@pytest.fixture
def explored(made, tmp_path, monkeypatch):
    """The dataset and the block, in a folder whose files a test may change."""
    shutil.copytree(made[0], tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return ibdata.open("x"), made[1]


def test_weights_of_custom_data_need_consent_and_states_no_code(explored, tmp_path):
    ds, block = explored
    with pytest.raises(UsageError, match="code that would run"):
        ibdata.importance(ds, "random")
    found = ibdata.importance(ds, block, allow_code=True)
    np.testing.assert_allclose(found.weights, 1.0, rtol=1e-6)  # recorded densities are float32
    (tmp_path / "explorer.py").unlink()
    assert np.float32(ibdata.state_at(ds, (5, 2)).mu_v[0]) == ds.to_pandas()["latent_mu_v"][5 * 3 + 2]


def test_code_of_the_data_that_was_changed_since_is_refused(explored, tmp_path):
    ds, block = explored
    (tmp_path / "helper_of_explorer.py").write_text("PUSH = 0.3\n")
    line = r"x: found other code than .*made with, in helper_of_explorer\.py; restore"
    with pytest.raises(UsageError, match=line):
        ibdata.importance(ds, block, allow_code=True)
