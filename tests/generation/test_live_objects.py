"""Objects of a Python session as policies of a run, which nobody can repeat."""

from unittest.mock import Mock

import numpy as np
import pytest

import ibdata
from ibdata.errors import Interrupted, UsageError


class Mine:
    def __init__(self, size):
        self.size, self.asked = size, 0

    def predict(self, observations):
        self.asked += 1
        return np.full((len(observations), 3), self.size)


@pytest.fixture
def plain():
    """An experiment with two objects, of which one is the base of another policy, and a function."""
    wrapped = {"kind": "epsilon_greedy", "base": Mine(-0.5), "epsilon": 0.0}
    policies = [Mine(0.5), wrapped, lambda observations: 0.0 * observations[:, 1:4], "random"]
    return {"name": "x", "setpoints": [20, 70], "steps": 3, "policies": policies}


def test_a_stop_says_that_it_begins_again(plain, monkeypatch):
    monkeypatch.setattr("ibdata.generation.build.finish", Mock(side_effect=Interrupted(2)))
    with pytest.raises(Interrupted, match=r"1 shard is finished; with an object of .*, a run begins again$"):
        ibdata.generate(plain, "out")


def test_an_object_acts_and_its_class_is_recorded(plain):
    made = ibdata.generate(plain, "out", workers=4)
    assert plain["policies"][0].asked >= 6
    actions = made.to_pandas().groupby("policy", observed=True)["act_velocity"].unique()
    assert (actions["mine"], actions["epsilon_greedy"], actions["lambda"]) == (0.5, -0.5, 0.0)
    assert made.manifest["reproducible"] is False
    assert [code["target"] for code in made.manifest["code"]] == ["live:Mine", "live:<lambda>"]
    first, second = (made.manifest["experiments"][0]["policies"][i] for i in (0, 2))
    assert (first["kind"], first["target"], first["history"]) == ("live", "Mine", 1)
    assert len(first["run"]) == 32
    assert first["run"] != second["run"]
    assert ibdata.validate("out") == []
    assert "Nobody can make it again: " in (made.path / "README.md").read_text()


def without_a_shard(plain):
    next((ibdata.open("out").path / "data").iterdir()).unlink()
    ibdata.repair("out", allow_code=True)


@pytest.mark.parametrize(
    "call",
    [
        lambda plain: ibdata.reproduce("out", allow_code=True),
        lambda plain: ibdata.generate(plain, "other", shards="1/2"),
        lambda plain: ibdata.generate("out/meta/experiment.yaml", "other"),
        without_a_shard,
    ],
)
def test_what_would_ask_it_again_is_refused_in_one_line(plain, call):
    ibdata.generate(plain, "out")
    with pytest.raises(UsageError, match=r"(out|x): found live:Mine, an object .* kind: custom$"):
        call(plain)


def test_a_second_run_is_another_experiment(plain):
    ibdata.generate(plain, "out")
    with pytest.raises(
        UsageError, match=r"out: holds the dataset of another object of this Python .*; --over"
    ):
        ibdata.generate(plain, "out")
    experiment = ibdata.load(plain, {"steps": 4})
    assert ibdata.estimate(experiment)["rows"] == 32
    made = ibdata.generate(experiment, "out", overwrite=True)
    assert ibdata.generate(experiment, "out").content_root == made.content_root
