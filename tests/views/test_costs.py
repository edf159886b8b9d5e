"""Costs beside the rewards: what they are, and that all that reads or simulates has the same ones."""

import numpy as np
import pytest

import ibdata
from ibdata.errors import UsageError
from ibdata.views.rewards import cost_of

FATIGUE, RUNAWAY = {"cost": {"fatigue": 40}}, {"cost": "runaway"}


@pytest.fixture(scope="module")
def ds(describe, made_at, tmp_path_factory):
    """Episodes that know the hidden state after each row."""
    experiment = describe(output={"latent": "next"}, policies=["random"], episodes=3, steps=60, splits={})
    return made_at(experiment, tmp_path_factory.mktemp("costs") / "next")


def by_hand(rows, view):
    """The costs of the rows of a table."""
    if view is FATIGUE:
        return (rows["next_obs_fatigue"] > 40).to_numpy()
    return (rows[["next_latent_mu_v", "next_latent_mu_g"]].max(axis=1) >= np.float32(1.2)).to_numpy()


@pytest.mark.parametrize("view", [FATIGUE, RUNAWAY])
def test_all_ways_to_read_have_the_costs_of_the_next_states(ds, view, tmp_path):
    expected = by_hand(ds.to_pandas(), view)
    assert 0.02 < expected.mean() < 0.98
    arrays = ds.arrays(history=3, view=view)
    assert (arrays["costs"].dtype, len(arrays["costs"])) == (np.float32, len(ds))
    windows = ds.windows(history=3, view=view, folder=tmp_path / "windows")
    tables = (ds.table(view=view), *ds.iter_batches(view=view))
    found = [arrays["costs"], windows.batch(range(len(windows)))["costs"], windows[5:]["costs"]]
    found += [table["cost"].to_numpy() for table in tables]
    for costs in found:
        assert costs.tolist() == expected[len(expected) - len(costs) :].tolist()
    ibdata.export(ds, "npz", tmp_path / "x.npz", view=view)
    ibdata.export(ds, "csv", tmp_path / "x.csv", view=view)
    with np.load(tmp_path / "x.npz") as file:
        assert file["costs"].tolist() == expected.tolist()
    header, first, *_ = (tmp_path / "x.csv").read_text().splitlines()
    assert dict(zip(header.replace('"', "").split(","), first.split(","), strict=True))["cost"] in "01"


@pytest.mark.parametrize(("cost", "expected"), [({"fatigue": 1.2}, [0, 0, 1]), ("runaway", [0, 1, 1])])
def test_a_fatigue_at_its_limit_costs_nothing_and_a_hidden_state_at_1_2_does(cost, expected):
    around = np.nextafter(np.float32(1.2), [np.float32(0), np.float32(1.2), np.float32(2)])
    assert cost_of(cost).of([around]).tolist() == expected


def test_formats_without_a_place_for_costs_refuse_them(ds, tmp_path):
    with pytest.raises(UsageError, match="cost: found one, but the format neorl has no place for costs"):
        ibdata.export(ds, "neorl", tmp_path / "x.npz", view=FATIGUE)


def test_an_evaluation_counts_steps_that_cost_and_episodes_over_the_budget():
    """A limit of 0 is exceeded at each step, one of 300 never."""
    for limit, budget, expected in ((0, 0, (8, 1)), (0, 7, (8, 1)), (0, 8, (8, 0)), (300, 0, (0, 0))):
        view = {"cost": {"fatigue": limit, "budget": budget}}
        [result] = ibdata.evaluate("random", steps=8, episodes=5, view=view).results
        assert (result.mean_cost, result.cost_error, result.violations) == (expected[0], 0, expected[1])
    assert result.mean_return == ibdata.evaluate("random", steps=8, episodes=5).results[0].mean_return
    assert "mean_cost" in repr(ibdata.evaluate("random", steps=8, episodes=5, view=view))
    assert "mean_cost" not in repr(ibdata.evaluate("random", steps=8, episodes=5))


@pytest.mark.parametrize(
    ("cost", "message"),
    [
        ("runway", "found 'runway', .*; did you mean 'runaway'"),
        ({"fatige": 60}, r"found \{'fatige': 60\}, expected \{fatigue: 60\}, runaway"),
        ({"fatigue": 60, "runaway": True}, "expected {fatigue: 60}, runaway"),
        ({"budget": 3}, "expected {fatigue: 60}"),
        ({}, "expected {fatigue: 60}"),
        ({"fatigue": -1}, "cost: fatigue: found -1, expected a finite number of at least 0"),
        ({"fatigue": 60, "budget": float("nan")}, "cost: budget: found nan, expected a finite number"),
        ({"runaway": True, "budget": True}, "cost: budget: found True"),
        (3, "cost: found 3, expected"),
    ],
)
def test_a_wrong_cost_is_one_line(cost, message):
    with pytest.raises(UsageError, match=message):
        cost_of(cost)
