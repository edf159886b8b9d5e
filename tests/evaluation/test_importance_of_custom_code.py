"""Importance weights of data that custom policies made, whose code must be that which made them."""

from __future__ import annotations

import numpy as np
import pytest

import ibdata
from ibdata.errors import UsageError
from ibdata.experiment import Experiment


def test_custom_code_of_the_data_needs_consent(tmp_path):
    custom = {"kind": "custom", "target": "ibdata.policies.safe:Safe", "uniforms": 5}
    experiment = Experiment(name="x", setpoints=70, episodes=3, steps=4, policies=[custom])
    ds = ibdata.generate(experiment, tmp_path / "x", workers=1, allow_code=True)
    with pytest.raises(UsageError, match="code that would run"):
        ibdata.importance(ds, "random")
    assert ibdata.importance(ds, "random", allow_code=True).notes[0].startswith("warning")


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


def test_code_of_the_data_that_was_changed_since_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other").mkdir()
    (tmp_path / "explorer.py").write_text(EXPLORER)
    (tmp_path / "helper_of_explorer.py").write_text("PUSH = 0.0\n")
    custom = {"kind": "custom", "target": "explorer.py:Explorer", "uniforms": 6}
    experiment = Experiment(name="x", setpoints=70, episodes=200, steps=3, policies=[custom])
    ds = ibdata.generate(experiment, "x", workers=1, allow_code=True)
    found = ibdata.importance(ds, custom, allow_code=True)
    np.testing.assert_allclose(found.weights, 1.0, rtol=1e-6)  # recorded densities are float32

    (tmp_path / "other/target.py").write_text(EXPLORER)
    (tmp_path / "other/helper_of_explorer.py").write_text("PUSH = 0.3\n")
    (tmp_path / "other/target.yaml").write_text("{kind: custom, target: 'target.py:Explorer', uniforms: 6}")
    with pytest.raises(UsageError, match="found another module with the name helper_of_explorer"):
        ibdata.importance(ds, "other/target.yaml", allow_code=True)
    (tmp_path / "other/target.py").write_text(
        EXPLORER.replace("from helper_of_explorer import PUSH", "PUSH = 0.3")
    )
    with pytest.raises(UsageError, match="are taken by custom, the policy of the data, less than once"):
        ibdata.importance(ds, "other/target.yaml", allow_code=True)

    (tmp_path / "helper_of_explorer.py").write_text("PUSH = 0.3\n")
    with pytest.raises(
        UsageError, match=r"x: found other code than .*made with, in helper_of_explorer\.py; re"
    ):
        ibdata.importance(ds, custom, allow_code=True)


def test_a_file_of_the_data_that_was_changed_since_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "read.py").write_text(EXPLORER.replace("from helper_of_explorer", "PUSH = 0.0  #"))
    (tmp_path / "weights.txt").write_text("1")
    custom = {"kind": "custom", "target": "read.py:Explorer", "uniforms": 6, "files": ["weights.txt"]}
    experiment = Experiment(name="x", setpoints=70, episodes=3, steps=3, policies=[custom])
    ds = ibdata.generate(experiment, "x", workers=1, allow_code=True)
    (tmp_path / "weights.txt").write_text("2")
    with pytest.raises(UsageError, match=r"x: found other code than .*made with, in weights\.txt; restore"):
        ibdata.importance(ds, custom, allow_code=True)
