"""The table of episodes says which policy of a mixture acts in an episode."""

from __future__ import annotations

import pytest

import ibdata

UP, DOWN = ({"kind": "constant", "action": [x] * 3} for x in (0.5, -0.5))
MIXTURE = {"kind": "mixture", "bases": [UP, "safe", DOWN], "weights": [2, 1, 1], "name": "mixed"}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    plain = {"name": "mixed", "setpoints": [20, 70], "steps": 3, "episodes": 20, "seed": 3}
    plain["output"] = {"shard_rows": 30}
    return ibdata.generate({**plain, "policies": ["random", MIXTURE]}, tmp_path_factory.mktemp("a") / "mixed")


def test_the_policy_that_acts_is_the_one_whose_actions_are_recorded(made):
    rows = made.to_pandas(columns=["episode", "act_velocity"])
    actions = rows.groupby("episode")["act_velocity"].agg(list)
    found = made.episodes["acting"].astype(str)
    assert set(found) == {"random", "constant", "safe", "constant-2"}
    assert (found[made.episodes["policy"] == "random"] == "random").all()
    for label, action in (("constant", 0.5), ("constant-2", -0.5)):
        for episode in made.episodes["episode"][found == label]:
            assert actions[episode] == [action] * 3
    assert (found == "constant").sum() > (found == "constant-2").sum() > 0


def test_it_stays_with_the_episode(made, tmp_path):
    other = ibdata.generate({"name": "x", "setpoints": 70, "steps": 3, "policies": ["safe"]}, tmp_path / "x")
    merged = ibdata.merge([other.path, made.path], out=tmp_path / "merged")
    assert merged.episodes["acting"].astype(str).tolist() == ["safe", *made.episodes["acting"]]
    (merged.path / "meta" / "episodes.parquet").unlink()
    ibdata.repair(merged.path)
    assert ibdata.validate(merged.path) == []
