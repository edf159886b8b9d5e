"""Objects of a Python session as policies of a run, which nobody can repeat."""

from unittest.mock import Mock

import pytest
from helpers.folders import part_of
from helpers.objects import Drawing, Mine
from helpers.refusals import refused

import ibdata
from ibdata.errors import Interrupted, UsageError


@pytest.fixture
def plain():
    """An experiment with two objects, of which one is the base of another policy, and a function."""
    wrapped = {"kind": "epsilon_greedy", "base": Mine(-0.5), "epsilon": 0.0}
    policies = [Mine(0.5), wrapped, lambda observations: 0.0 * observations[:, 1:4], "random"]
    return {"name": "x", "setpoints": [20, 70], "steps": 3, "policies": policies}


def test_an_object_acts_and_its_class_is_recorded(plain):
    made = ibdata.generate(plain, "out", workers=4)
    assert plain["policies"][0].asked >= 6
    actions = made.to_pandas().groupby("policy", observed=True)["act_velocity"].unique()
    assert (actions["mine"], actions["epsilon_greedy"], actions["lambda"]) == (0.5, -0.5, 0.0)
    assert made.manifest["reproducible"] is False
    assert [code["target"] for code in made.manifest["code"]] == ["live:Mine", "live:<lambda>"]
    first, second = (made.manifest["experiments"][0]["policies"][i] for i in (0, 2))
    assert (first["kind"], first["target"], first["history"]) == ("live", "Mine", 1)
    assert (second["kind"], second["target"]) == ("live", "<lambda>")
    assert ibdata.validate("out") == []
    assert "Nobody can make it again: " in (made.path / "README.md").read_text()


def without_a_shard():
    next((ibdata.open("out").path / "data").iterdir()).unlink()
    ibdata.repair("out", allow_code=True)


def test_what_would_ask_it_again_is_refused_in_one_line(plain):
    ibdata.generate(plain, "out")
    for call in (
        lambda: ibdata.reproduce("out", allow_code=True),
        lambda: ibdata.generate(plain, "other", shards="1/2"),
        lambda: ibdata.generate("out/meta/experiment.yaml", "other"),
        without_a_shard,
    ):
        refused(r"(out|x): found live:Mine, an object .* kind: custom$", call)


def test_a_dataset_of_an_object_is_never_already_there(plain):
    """Nobody can tell whether it is that of this object, or of the same as it is now."""
    made = ibdata.generate(plain, "out")
    with pytest.raises(
        UsageError, match=r"^out: holds the dataset of an object of a Python session; overwrite=True"
    ):
        ibdata.generate(plain, "out")
    assert ibdata.generate(plain, "out", overwrite=True).content_root == made.content_root
    experiment = ibdata.load(ibdata.load(plain), {"steps": 4, "policies.1.epsilon": 1.0})
    with pytest.raises(UsageError, match=r"^out: holds the dataset of another .*policies.1.epsilon: found 0"):
        ibdata.generate(experiment, "out")


def test_a_stopped_run_of_an_object_begins_again(plain, monkeypatch, capsys):
    plain["policies"], first = [Mine(0.5)], Mine(-0.5)
    with monkeypatch.context() as stopping:
        stopping.setattr("ibdata.generation.build.finish", Mock(side_effect=Interrupted(2)))
        with pytest.raises(Interrupted, match=r"; nothing unfinished is left behind$"):
            ibdata.generate({**plain, "policies": [first]}, "out")
    assert not part_of("out").exists()
    assert ibdata.estimate(plain, "out")["action"] == "make it"
    assert (ibdata.generate(plain, "out").to_pandas()["act_gain"] == 0.5).all()
    assert capsys.readouterr().err == ""


DRAWING = {"kind": "custom", "draws": 3}
TWO = {"name": "x", "setpoints": 70, "steps": 4}


def two(**options):
    """An experiment with two objects of one class, and one within another policy."""
    blocks = [{**DRAWING, "target": Drawing()} for _ in range(3)]
    wrapped = {"kind": "sticky", "base": blocks.pop(), "kappa": 0.5}
    return ibdata.Experiment(**{**TWO, "policies": [*blocks, wrapped], **options})


def test_objects_of_one_class_draw_apart_and_the_same_everywhere():
    made = ibdata.generate(two(), "out")
    assert ibdata.generate(two(), "again").content_root == made.content_root
    assert made.to_pandas().groupby("policy", observed=True)["act_gain"].first().nunique() == 3
    assert made.content_root == "e346c8648d98dda8e7fc4c4c0178e4d04ee2d4afee8ee623f9a6c34e262229b5"


def test_two_runs_of_one_class_and_seed_are_not_merged():
    ibdata.generate(two(), "one")
    ibdata.generate(two(), "two")
    refused(r"policy drawing: the same .* in one; leave one out, or", ibdata.merge, ["one", "two"], "both")
    named = [{**DRAWING, "target": Drawing(), "name": "other"}]
    ibdata.generate(two(policies=named), "named")
    ibdata.generate(two(seed=1), "seeded")
    assert len(ibdata.merge(["one", "named", "seeded"], "both")) == 7 * TWO["steps"]
