"""Files with custom policies: where they are looked for, and what they may import."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from helpers.own_code import described, sha256
from helpers.policies import ready

import ibdata
from ibdata.errors import UsageError
from ibdata.evaluation.policies import as_policy
from ibdata.experiment import as_yaml

BESIDE = """
import numpy as np
from size_of_mine import SIZE

class Own:
    def predict(self, observations):
        return np.full((len(observations), 3), SIZE)
"""


@pytest.fixture
def beside(tmp_path, monkeypatch):
    """`run(target)` generates from exp/own.yaml, with code in exp/ and exp/code/; sys.path is restored."""
    (tmp_path / "exp/code").mkdir(parents=True)
    (tmp_path / "exp/code/own-policy.py").write_text(BESIDE)
    (tmp_path / "exp/code/size_of_mine.py").write_text("SIZE = 0.5")
    (tmp_path / "exp/policy_beside.py").write_text(
        BESIDE.replace("from size_of_mine import SIZE", "SIZE = 0.5")
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))

    def run(target, out="out", **options):
        (tmp_path / "exp/own.yaml").write_text(as_yaml(described(target=target)).decode())
        return ibdata.generate("exp/own.yaml", out, **{"workers": 1, "allow_code": True, **options})

    return run


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_a_file_is_found_with_what_it_imports_of_which_an_edit_makes_new_data(beside, tmp_path, workers):
    made = beside("code/own-policy.py:Own", workers=workers)
    assert (made.to_pandas()["act_gain"] == 0.5).all()
    (code,) = made.manifest["code"]
    folder = tmp_path / "exp/code"
    assert code["target"] == "code/own-policy.py:Own"
    assert code["sha256"] == sha256(folder / "own-policy.py")
    assert code["files"] == {"size_of_mine.py": sha256(folder / "size_of_mine.py")}
    (folder / "size_of_mine.py").write_text("SIZE = 0.25")
    with pytest.raises(UsageError, match=r"out: holds .* other code, in size_of_mine\.py; overwrite=True"):
        beside("code/own-policy.py:Own")
    again = beside("code/own-policy.py:Own", overwrite=True)
    assert again.content_root != made.content_root
    assert (again.to_pandas()["act_gain"] == 0.25).all()


@pytest.mark.slow
def test_a_missing_file_is_expected_in_places_that_are_named(beside, tmp_path):
    beside("code/own-policy.py:Own")
    assert ibdata.validate("out") == []
    line = r"^code/own-policy\.py:Own: found no file 'code/own-policy\.py', expected it beside .*: "
    here = f"{tmp_path}/code/own-policy.py; "
    with pytest.raises(UsageError, match=f"{line}{here}"):
        ibdata.reproduce("out", allow_code=True)
    missing = r"policies\.0\.target: found no file 'code/own-policy\.py', expected it beside .*: "
    named = rf"^out/meta/experiment\.yaml:\d+:\d+: {missing}"
    with pytest.raises(UsageError, match=f"{named}{tmp_path}/out/meta/code/own-policy.py or {here}"):
        ibdata.generate("out/meta/experiment.yaml", "again", workers=1, allow_code=True)
    (tmp_path / "exp/code").rename("code")
    assert ibdata.reproduce("out", allow_code=True) == (2, [])
    again = ibdata.generate("out/meta/experiment.yaml", "again", workers=1, allow_code=True)
    assert again.content_root == ibdata.open("out").content_root


def test_a_policy_keeps_its_folder_where_it_is_checked_again(beside, tmp_path):
    """In an experiment and an evaluation; and a copy of a policy around it has the folder too."""
    block = "{kind: custom, target: policy_beside.py:Own}"
    (tmp_path / "exp/around.yaml").write_text(f"{{kind: epsilon_greedy, base: {block}, epsilon: 0.1}}")
    around = as_policy("exp/around.yaml", allow_code=True)
    described = {"name": "x", "setpoints": 70, "policies": [around.base]}
    made = [ibdata.Experiment(**described), ibdata.load(described)]
    changed = around.model_copy(update={"epsilon": 0.2})
    new = around.model_copy(update={"base": {"kind": "custom", "target": "policy_beside.py:Own", "draws": 1}})
    for policy in [around, changed, new, *(each.policies[0] for each in made)]:
        assert ready(policy).checked_with["folder"] == Path("exp")


def test_policies_of_several_files_are_found_beside_each(tmp_path, monkeypatch):
    """Also by the process in which they act, and by the search for what was edited since."""
    monkeypatch.chdir(tmp_path)
    policies = []
    for gain in (0.25, 0.5):
        folder = tmp_path / f"of-{gain}"
        folder.mkdir()
        (folder / f"{folder.name}.py").write_text(
            f"def own(observations):\n    return 0 * observations[:, :3] + {gain}"
        )
        (folder / "x.yaml").write_text(as_yaml(described(target=f"{folder.name}.py:own")).decode())
        policies += ibdata.load(folder / "x.yaml").policies
    several = {"name": "own", "setpoints": 70, "policies": policies, "steps": 4}
    made = ibdata.generate(several, "made", workers=1, allow_code=True)
    assert set(made.to_pandas()["act_gain"]) == {0.25, 0.5}
    (tmp_path / "of-0.5/of-0.5.py").write_text("own = None")
    with pytest.raises(UsageError, match=r"made: holds .* other code, in of-0\.5\.py:own"):
        ibdata.generate(several, "made", workers=1, allow_code=True)
