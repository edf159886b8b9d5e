"""Returns and scores of a dataset's behaviour."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import ibdata
from ibdata.cli import cli
from ibdata.dataset.reference_returns import scale
from ibdata.dataset.returns import averages


def shown(*args):
    """What `ibdata info` prints."""
    return CliRunner().invoke(cli, ["info", *map(str, args)], catch_exceptions=False).stdout


def test_returns_are_by_policy_and_setpoint(dataset):
    found = dataset.returns()
    frame = dataset.episodes
    assert [(r["policy"], r["setpoint"]) for r in found["results"]] == [
        (policy, p) for policy in ("random", "calm") for p in (20.0, 70.0)
    ]
    for r in found["results"]:
        rows = frame[(frame["policy"] == r["policy"]) & (frame["setpoint"] == r["setpoint"])]["return"]
        assert r["episodes"] == len(rows) == 3
        assert r["mean_return"] == pytest.approx(rows.mean())
        assert r["standard_error"] == pytest.approx(rows.std() / np.sqrt(3))
        assert r["mean_reward"] == pytest.approx(rows.mean() / 40)
        assert r["reference"] is r["score"] is r["score_error"] is None
    assert found["scale"] is None


@pytest.fixture(scope="module")
def whole(describe, tmp_path_factory):
    """Episodes of 1000 steps, for which there is a scale."""
    changes = {"setpoints": [69, 70], "steps": 1000, "policies": [{"kind": "optimized"}]}
    return ibdata.generate(describe(**changes), tmp_path_factory.mktemp("whole") / "made", workers=1)


def test_whole_episodes_from_the_default_start_have_a_score(whole):
    found = whole.returns()
    assert [r["score"] is None for r in found["results"]] == [True, False]  # no reference at 69
    assert found["results"][1]["score"] == pytest.approx(100.0, abs=3.0)
    made = scale("siemens", "default", 1000, 1.0)
    assert found["results"][1]["score"] == made.score(70.0, found["results"][1]["mean_return"])
    low, high = found["results"][1]["reference"]
    error = found["results"][1]["standard_error"]
    assert found["results"][1]["score_error"] == pytest.approx(100.0 * error / (high - low))
    assert found["scale"] == made.text
    assert "score: 0 = random, 100 = optimized" in shown(whole.path)
    assert "at the same setpoint: " in shown(whole.path)


def test_one_episode_has_its_return_and_the_reference_and_no_score(describe, tmp_path):
    """The score of one episode would be off by 36 to 54, and nothing would say so."""
    changes = {"setpoints": [40, 60], "steps": 1000, "episodes": 1, "policies": ["random"]}
    ds = ibdata.generate(describe(**changes), tmp_path / "one")
    found = ds.returns()
    made = scale("siemens", "default", 1000, 1.0)
    assert [r["reference"] for r in found["results"]] == [made.ends([40.0]), made.ends([60.0])]
    assert [(r["score"], r["score_error"]) for r in found["results"]] == [(None, None)] * 2
    assert averages(found["results"])[0].score is None
    assert "; one episode has none" in shown(ds.path)


@pytest.fixture(scope="module")
def mixed(describe, whole, tmp_path_factory):
    """Episodes of 1000 steps at 69 and 70, then of 40 at 70 and 70.5, the first one's cell among them."""
    changes = {"setpoints": [70, 70.5], "seed": 3, "policies": [{"kind": "optimized"}]}
    folder = tmp_path_factory.mktemp("mixed")
    short = ibdata.generate(describe(**changes), folder / "short", workers=1)
    return ibdata.merge([whole.path, short.path], folder / "mixed")


def test_merged_results_have_the_steps_of_their_episodes(mixed, whole):
    found = mixed.returns()
    assert found["results"][:2] == whole.returns()["results"]
    assert found["scale"] == whole.returns()["scale"]
    assert [r["setpoint"] for r in found["results"]] == [69.0, 70.0, 70.0, 70.5]
    frame = mixed.episodes
    for i, r in enumerate(found["results"]):
        rows = frame[3 * i : 3 * i + 3]
        assert r["episodes"] == 3
        assert r["mean_return"] == pytest.approx(rows["return"].mean())
        assert r["mean_reward"] == pytest.approx((rows["return"] / rows["length"]).mean())
    assert [r["score"] is None for r in found["results"]] == [True, False, True, True]
    assert "in 12 episodes of 1,000 or 40 steps\n" in shown(mixed.path)
    assert json.loads(shown(mixed.path, "--json"))["returns"] == json.loads(json.dumps(found))


def test_averages_are_over_setpoints_and_over_policies(dataset):
    made = averages(dataset.returns()["results"])
    assert [(a.policy, a.episodes, a.steps, a.score) for a in made] == [
        ("random", 6, 40, None), ("calm", 6, 40, None), (None, 12, 40, None)
    ]  # fmt: skip
    frame = dataset.episodes
    for a in made:
        rows = frame if a.policy is None else frame[frame["policy"] == a.policy]
        cells = rows.groupby("cell", observed=True)["return"]
        assert a.mean_return == pytest.approx(rows["return"].mean())
        assert a.mean_reward == pytest.approx(rows["return"].mean() / 40)
        assert a.standard_error == pytest.approx(np.sqrt((cells.var() / 3).sum()) / cells.ngroups)


def test_setpoints_count_alike_in_merged_data(tmp_path):
    """More episodes at one setpoint, before or after the others, are those of the same cell."""
    plain = {"setpoints": [10, 100], "policies": ["random"], "episodes": 8, "steps": 50}
    a = ibdata.generate({**plain, "name": "a"}, tmp_path / "a", workers=1)
    b = ibdata.generate({**plain, "name": "b", "setpoints": 10, "seed": 1}, tmp_path / "b", workers=1)
    safe = ibdata.generate(
        {**plain, "name": "c", "setpoints": 10, "policies": ["safe"]}, tmp_path / "c", workers=1
    )
    ab, ba = (ibdata.merge(parts, out=tmp_path / name) for parts, name in (([a, b], "ab"), ([b, a], "ba")))
    rows = ab.episodes
    at = {p: rows["return"][rows["setpoint"] == p].mean() for p in (10, 100)}
    for merged in (ab, ba):
        results = merged.returns()["results"]
        assert [(r["setpoint"], r["episodes"]) for r in results] == [(10.0, 16), (100.0, 8)]
        [average] = averages(results)
        assert average.mean_return == pytest.approx((at[10] + at[100]) / 2)
    three = ibdata.merge([ab, safe], out=tmp_path / "three")
    both = (at[10] + safe.episodes["return"].mean()) / 2
    assert averages(three.returns()["results"])[-1].mean_return == pytest.approx((both + at[100]) / 2)
