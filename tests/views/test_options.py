"""Views: what they show, what they cost, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import ibdata
from ibdata.errors import UsageError
from ibdata.views.options import bounds_of, view_options
from ibdata.views.rewards import cost_of, reward_of


def test_a_frame_has_columns_then_flags_then_the_actions_before():
    imperfections = {"missing": {"obs_gain": 0.1}, "delay": {"obs_velocity": 1}, "mask": True}
    options = view_options(["obs_gain", "obs_velocity"], True, imperfections=imperfections)
    assert view_options(iter(["obs_gain", "obs_velocity"])) == view_options(["obs_gain", "obs_velocity"])
    assert options.frame(drifting=False) == (
        *("obs_gain", "obs_velocity", "missing_obs_gain"),
        *("previous_act_velocity", "previous_act_gain", "previous_act_shift"),
    )


def test_bounds_are_those_of_exact_columns():
    imperfections = {"noise": {"obs_velocity": 1.0}, "missing": {"obs_gain": 0.5}, "mask": True}
    options = view_options(["obs_velocity", "obs_gain", "latent_mu_v"], True, imperfections=imperfections)
    assert bounds_of(options, False) == [(None, None), (0, 100), (0, 5), (0, 1), *[(-1, 1)] * 3]
    assert bounds_of(view_options(), False, (-7.0, 9.0))[-1] == (-7.0, 9.0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"observe": "makrov"}, "observe: found 'makrov', expected classic, markov .* did you mean 'markov'"),
        ({"observe": ["obs_gian"]}, "found 'obs_gian', expected columns .* did you mean 'obs_gain'"),
        ({"observe": ["reward"]}, "observe: found 'reward', expected columns obs_… or latent_…"),
        ({"actions": "yes"}, "actions: found 'yes', expected True or False"),
        ({"reward_scale": 0}, "reward_scale: found 0, expected a finite number above 0"),
        ({"reward": "detla"}, "reward: found 'detla', expected classic, delta .* did you mean 'delta'"),
        ({"reward": {"fatique": 1}}, "found 'fatique', expected weights .* did you mean 'fatigue'"),
        ({"reward": {"fatigue": float("nan")}}, "reward: fatigue: found nan, expected a finite number"),
        ({"imperfections": {"dealy": {}}}, "imperfections: dealy: no such option; did you mean 'delay'"),
        ({"imperfections": {"delay": {"obs_gain": 1.5}}}, "obs_gain: found 1.5, expected a whole number"),
        ({"imperfections": {"noise": {"obs_gain": -1}}}, "found -1, expected a standard deviation above 0"),
        ({"imperfections": {"missing": {"obs_gain": 2}}}, "found 2, expected a probability"),
        ({"imperfections": {"mask": 1}}, "imperfections: mask: found 1, expected True or False"),
        ({"imperfections": {"seed": -1}}, "imperfections: seed: found -1, expected a whole number"),
        (
            {"observe": ["obs_gain"], "imperfections": {"delay": {"obs_velocity": 1}}},
            "imperfections: found 'obs_velocity', expected one of the observed columns",
        ),
    ],
)
def test_what_is_no_view_is_refused(given, message):
    with pytest.raises(UsageError, match=message):
        view_options(**given)


BEFORE = np.array([100.1, 3.0], np.float32), np.array([10.7, 0.5], np.float32)  # consumption, fatigue
AFTER = np.array([90.3, 4.0], np.float32), np.array([12.9, 0.25], np.float32)


@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_weights_are_computed_in_float64_and_rounded_once(scale):
    assert reward_of({"fatigue": 2}).of(BEFORE, AFTER, 1.0).tolist() == (-2 * AFTER[1]).tolist()
    found = reward_of({"consumption": 0.7, "fatigue": 2.2}).of(BEFORE, AFTER, scale)
    exact = [-(0.7 * float(c) + 2.2 * float(f)) * scale for c, f in zip(*AFTER, strict=True)]
    assert found.tolist() == np.array(exact).astype(np.float32).tolist()
    assert found.dtype == np.float32


def test_rewards_that_become_infinite_are_refused():
    with pytest.raises(
        UsageError, match=r"reward: found weights or a scale .1e.300. that make rewards infin"
    ):
        reward_of("delta").of(BEFORE, AFTER, 1e300)
    with np.errstate(all="ignore"), pytest.raises(UsageError, match="that make rewards infinite"):
        reward_of({"consumption": 1e308, "fatigue": -1e308}).of(BEFORE, AFTER, 1.0)  # inf - inf


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
