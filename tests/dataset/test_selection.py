"""Rows by setpoint, policy and split; test_ways.py reads them in all ways."""

import math
from itertools import product

import numpy as np
import pandas as pd
import pytest
from helpers.refusals import refused
from helpers.splits import by_policy

import ibdata
from ibdata.errors import UsageError

pytestmark = pytest.mark.portable


@pytest.fixture(scope="module")
def labelled(declared, made_at, tmp_path_factory):
    """The dataset of the other tests with splits that are labels, beside those that are files."""
    made = made_at(declared, tmp_path_factory.mktemp("selection") / "small")
    return ibdata.split(made.path, by_policy("random", "calm"))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_a_setpoint_that_float32_cannot_hold_is_found_and_joined(describe, made_at, tmp_path, dtype):
    """The rows and the table of episodes have one type and value; 20.1 stays 20.1 for people."""
    experiment = describe(setpoints=[20.1, 70], output={"dtype": dtype})
    dataset = made_at(experiment, tmp_path / "odd")
    files = (pd.read_parquet(dataset.path / part) for part in ("data", "meta/episodes.table"))
    for rows, episodes in (files, (dataset.to_pandas(), dataset.episodes)):
        assert rows["obs_setpoint"].dtype == episodes["setpoint"].dtype == dtype
        keys = {"left_on": ["episode", "obs_setpoint"], "right_on": ["episode", "setpoint"]}
        assert len(rows.merge(episodes, **keys)) == len(rows) == 480
    stored = np.dtype(dtype).type(20.1)
    for setpoint in (20.1, np.float64(20.1), [20.1], pd.Series([20.1]), stored, float(stored)):
        assert len(dataset.select(setpoint=setpoint)) == 240
    filters = [("obs_setpoint", "==", stored)]
    assert len(pd.read_parquet(dataset.path / "data", filters=filters)) == 240
    refused(r"found 20.3, expected one of 20.1, 70", dataset.select, setpoint=20.3)
    assert {r["setpoint"] for r in dataset.returns()["results"]} == {20.1, 70.0}
    split = ibdata.split(dataset.path, {"source": {"setpoint": 70}, "target": {"setpoint": 20.1}})
    assert (split.splits["target"]["rows"], ibdata.validate(split)) == (240, [])


WRONG = [
    ({"episodes": 12}, "episodes: found 12, expected one of 0 to 11"),
    ({"episodes": [3, -1]}, "episodes: found -1, expected one of 0 to 11"),
    ({"episodes": 1.5}, "episodes: found 1.5, expected a whole number"),
    ({"returns": (2.0, 1.0)}, "returns: found [2.0, 1.0], expected the lowest and the highest one"),
    ({"returns": (1.0,)}, "returns: found [1.0], expected the lowest and the highest one"),
    ({"returns": (math.nan, None)}, "returns: found [nan, None], expected the lowest and the highest"),
    ({"returns": -3.0}, "returns: found -3.0, expected a list of numbers or None"),
    ({"setpoint": [20, 7]}, "setpoint: found 7, expected one of 20, 70"),
    ({"policy": "clam"}, "policy: found 'clam'; did you mean 'calm'?"),
    ({"split": "sorce"}, "split: found 'sorce'; did you mean 'source'?"),
    ({"split": ["source", "tgt"]}, "split: found 'tgt'; did you mean 'target'?"),
    ({"split": 3}, "split: found 3, expected a text, a list of texts or None"),
]


def test_a_wrong_choice_is_one_line_with_what_is_meant_or_known(labelled):
    for choice, line in WRONG:
        with pytest.raises(UsageError) as error:
            labelled.select(**choice)
        assert str(error.value).startswith(line)
        assert "\n" not in str(error.value)
    for read in (labelled.to_pandas, labelled.table, labelled.arrays):
        refused(r"^column: found 'rewards'; did you mean 'reward'\?", read, columns=["rewards"])


def test_a_selection_is_measured_as_its_rows_are(labelled, tmp_path):
    selected = labelled.select(["calm", "target"], setpoint=70)
    rows = selected.to_pandas()
    assert selected.statistics()["reward"]["mean"] == pytest.approx(rows["reward"].mean(), rel=1e-6)
    groups = rows.groupby("policy", observed=True)
    returns = (groups["reward"].sum() / groups["episode"].nunique()).to_dict()
    found = {r["policy"]: r["mean_return"] for r in selected.returns()["results"]}
    assert found == pytest.approx(returns, rel=1e-5)
    assert ibdata.quality(selected).rows == len(rows)
    assert ibdata.export(selected, "npz", tmp_path / "x.npz").rows == len(rows)
    assert len(ibdata.importance(selected, "random", discount=0.5).rewards) == rows["episode"].nunique()
    assert len(ibdata.noise_floor(selected).mean) == len(rows)
    narrower = selected.select(policy="calm")
    assert narrower.to_pandas()["reward"].equals(rows["reward"][rows["policy"] == "calm"])
    assert narrower.head(2).to_pylist() == narrower.table().to_pylist()[:2]


def test_what_is_of_a_whole_dataset_refuses_a_selection(labelled):
    selected = labelled.select("source")
    assert (selected.place, selected.content_root) == (labelled.place, labelled.content_root)
    more = (lambda ds: ibdata.merge([ds, ds], "out"), lambda ds: ibdata.state_at(ds, 0))
    for call in (ibdata.validate, ibdata.split, ibdata.repair, *more):
        refused("found a selection of its episodes, expected the whole dataset", call, selected)
    refused("at: found a split or a selection too", selected.head, at=(0, 0))


EMPTY = [{"split": "source", "setpoint": 70}, {"returns": (1e9, None)}, {"episodes": np.array([])}]
EMPTY += [{name: []} for name in ("split", "setpoint", "policy")]


def test_an_empty_selection_has_no_rows_to_read(labelled):
    names = ("table", "to_pandas", "arrays", "windows", "statistics", "returns", "head")
    reads = [*(getattr(ibdata.Dataset, name) for name in names), ibdata.quality]
    for read, conditions in product(reads, EMPTY):
        nothing = labelled.select(**conditions)
        assert len(nothing) == len(nothing.episodes) == 0
        with pytest.raises(
            UsageError, match=r"^split, setpoint, policy, episodes, returns: found no episode that meets all"
        ):
            read(nothing)
