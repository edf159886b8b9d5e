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
from ibdata.policies.support import EDGES, INSIDE, each

class Explorer:  # a component is exactly -1 or 1 with the probability PUSH
    support = each(INSIDE, EDGES) if PUSH else each(INSIDE)

    def act(self, history, u):
        uniform = 2.0 * u[:, :3] - 1.0
        return np.where(u[:, 3:] < PUSH, np.sign(uniform), uniform)

    def log_prob(self, history, action):
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
    with pytest.raises(UsageError, match="found point masses at ±1"):
        ibdata.importance(ds, "other/target.yaml", allow_code=True)

    (tmp_path / "helper_of_explorer.py").write_text("PUSH = 0.3\n")
    with pytest.raises(
        UsageError, match=r"x: found other code than .*made with, in helper_of_explorer\.py; re"
    ):
        ibdata.importance(ds, custom, allow_code=True)


def test_a_module_of_the_data_that_the_target_imports_while_it_is_played_is_refused(tmp_path, monkeypatch):
    """The policy of the data has no part in it, but the module is where its own ones are looked for."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other").mkdir()
    same = EXPLORER.replace("from helper_of_explorer", "PUSH = 0.0  #")
    begin = "    def log_prob(self, history, action):"
    (tmp_path / "first.py").write_text(same)
    (tmp_path / "other/second.py").write_text(same.replace(begin, f"{begin}\n        import late_helper"))
    for folder in (tmp_path, tmp_path / "other"):
        (folder / "late_helper.py").write_text("")
    custom = {"kind": "custom", "target": "first.py:Explorer", "uniforms": 6}
    experiment = Experiment(name="x", setpoints=70, episodes=3, steps=3, policies=[custom])
    ds = ibdata.generate(experiment, "x", workers=1, allow_code=True)
    (tmp_path / "other/target.yaml").write_text("{kind: custom, target: 'second.py:Explorer', uniforms: 6}")
    with pytest.raises(UsageError, match=r"other/late_helper\.py: found another module with the name late_h"):
        ibdata.importance(ds, "other/target.yaml", allow_code=True)


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


OPTIONAL = "try:\n    from settings_of_explorer import PUSH\nexcept ImportError:\n    PUSH = 0.0\n"
REFUSED = r"x: found other code than .*made with, in .*settings_of_explorer(/__init__)?\.py"


def test_a_module_of_the_data_that_appeared_or_vanished_or_became_a_package_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    settings, package = tmp_path / "settings_of_explorer.py", tmp_path / "settings_of_explorer"
    (tmp_path / "explorer.py").write_text(EXPLORER.replace("from helper_of_explorer import PUSH", OPTIONAL))
    (tmp_path / "other.py").write_text(EXPLORER.replace("from helper_of_explorer", "PUSH = 0.0  #"))
    custom = {"kind": "custom", "target": "explorer.py:Explorer", "uniforms": 6}
    other = {"kind": "custom", "target": "other.py:Explorer", "uniforms": 6, "name": "other"}
    experiment = Experiment(name="x", setpoints=70, episodes=3, steps=3, policies=[custom, other])
    ds = ibdata.generate(experiment, "x", workers=1, allow_code=True)
    settings.write_text("PUSH = 0.3\n")
    with pytest.raises(UsageError, match=REFUSED):
        ibdata.importance(ds, custom, policy="custom", allow_code=True)
    assert ibdata.importance(ds, other, policy="other", allow_code=True).weights.shape == (3, 3)

    ds = ibdata.generate(experiment, "x", workers=1, allow_code=True, overwrite=True)
    assert ibdata.importance(ds, custom, policy="custom", allow_code=True).weights.shape == (3, 3)
    package.mkdir()
    settings.rename(package / "__init__.py")
    with pytest.raises(UsageError, match=REFUSED):
        ibdata.importance(ds, custom, allow_code=True)
    (package / "__init__.py").rename(package / "elsewhere.py")
    with pytest.raises(UsageError, match=REFUSED):
        ibdata.importance(ds, custom, allow_code=True)
    assert ibdata.importance(ds, other, policy="other", allow_code=True).weights.shape == (3, 3)
