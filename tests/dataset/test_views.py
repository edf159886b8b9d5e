"""Views of a dataset: the same values as its columns, whatever way they are read."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

import ibdata
from ibdata.errors import UsageError
from ibdata.views.options import view_options

TROUBLES = {
    "delay": {"obs_fatigue": 3},
    "noise": {"obs_consumption": 2.0},
    "missing": {"obs_velocity": 0.2},
    "mask": True,
}
MARKOV = view_options("markov")
EXPERIMENT = {
    "name": "viewed",
    "setpoints": [20.0, 70.0],
    "policies": ["random", "safe"],
    "episodes": 2,
    "steps": 12,
    "output": {"shard_rows": 30},
}


@pytest.fixture(scope="module")
def without(tmp_path_factory):
    """A dataset without the latent state after the last row."""
    return ibdata.generate(EXPERIMENT, tmp_path_factory.mktemp("without") / "made", workers=1)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    given = {**EXPERIMENT, "output": {"shard_rows": 30, "latent": "next"}}
    return ibdata.generate(given, tmp_path_factory.mktemp("whole") / "made", workers=1)


def test_the_classic_view_is_the_default_and_the_stored_reward(whole):
    plain, named = (
        whole.arrays(),
        whole.arrays(view={"observe": "classic", "reward": "classic", "actions": False}),
    )
    assert all((plain[name] == named[name]).all() for name in plain)
    assert (plain["rewards"] == whole.table(["reward"])["reward"].to_numpy()).all()


def test_markov_frames_are_the_columns_in_their_order(whole):
    arrays, frame = whole.arrays(view={"observe": "markov"}), MARKOV.frame(drifting=False)
    rows = whole.to_pandas()
    assert (arrays["observations"] == rows[list(frame)].to_numpy()).all()
    assert (arrays["next_observations"] == rows[[f"next_{name}" for name in frame]].to_numpy()).all()


def test_last_rows_without_a_next_state_are_left_out(whole, without):
    found, expected = (
        without.arrays(view={"observe": "markov"}, history=3),
        whole.arrays(view={"observe": "markov"}, history=3),
    )
    kept = expected["step"] < 11
    for name in found.keys() - {"truncated"}:
        assert (found[name] == expected[name][kept]).all()
    assert found["truncated"].tolist() == (found["step"] == 10).tolist()
    assert without.windows(view={"observe": "markov"}).left_out == 8
    assert whole.windows(view={"observe": "markov"}).left_out == 0


def test_a_list_of_observed_columns_needs_no_next_latent_state(without):
    arrays = without.arrays(view={"observe": ["obs_fatigue", "obs_velocity"]})
    assert (arrays["observations"] == without.arrays()["observations"][:, [4, 1]]).all()
    assert len(arrays["rewards"]) == len(without)


def test_previous_actions_are_of_the_row_before_or_zero(whole):
    arrays = whole.arrays(view={"actions": True}, history=2)
    frames, after = (arrays[name].reshape(-1, 2, 9) for name in ("observations", "next_observations"))
    assert (after[:, 0, 6:] == arrays["actions"]).all()
    begun = arrays["step"] > 0
    assert (frames[begun, 0, 6:] == arrays["actions"][:-1][begun[1:]]).all()
    assert (frames[~begun][:, :, 6:] == 0).all()


def test_weights_of_the_benchmark_give_its_reward_up_to_rounding(whole):
    classic, other = (
        whole.arrays(view={"reward": r})["rewards"] for r in ("classic", {"consumption": 1, "fatigue": 3})
    )
    assert (abs(classic - other) <= 2.0**-22 * abs(classic)).all()


def test_delta_sums_to_the_change_over_the_episode(whole):
    rows, delta = whole.to_pandas(), whole.arrays(view={"reward": "delta", "reward_scale": 0.5})["rewards"]
    cost = rows["obs_consumption"] + 3.0 * rows["obs_fatigue"]
    later = rows["next_obs_consumption"] + 3.0 * rows["next_obs_fatigue"]
    sums = np.add.reduceat(delta, np.flatnonzero(rows["step"] == 0))
    change = 0.5 * (cost[rows["step"] == 0].to_numpy() - later[rows["truncated"]].to_numpy())
    assert sums == pytest.approx(change, rel=1e-4)


@pytest.mark.parametrize(
    "view",
    [
        {"observe": "markov", "actions": True},
        {"imperfections": TROUBLES, "reward": "delta"},
        {"observe": ["latent_mu_v", "obs_gain"], "reward": {"fatigue": 1}},
    ],
    ids=["markov", "troubles", "list"],
)
@pytest.mark.parametrize("selection", [{}, {"setpoint": 70, "policy": "safe"}], ids=["all", "some"])
@pytest.mark.parametrize("which", ["whole", "without"])
def test_arrays_batches_and_windows_hold_the_same_values(request, which, view, selection):
    dataset = request.getfixturevalue(which)
    arrays = dataset.arrays(**selection, view=view)
    batches = pa.Table.from_batches(list(dataset.iter_batches(batch_rows=7, **selection, view=view)))
    frame = dataset.windows(view=view).frame
    for prefix, name in (("", "observations"), ("next_", "next_observations")):
        columns = [batches[f"{prefix}{column}"].to_numpy() for column in frame]
        assert (np.stack(columns, axis=1) == arrays[name]).all()
    for column, name in (("reward", "rewards"), ("truncated", "truncated"), ("episode", "episode")):
        assert (batches[column].to_numpy() == arrays[name]).all()
    for history, pad in ((1, "repeat"), (5, "repeat"), (5, "drop"), (40, "repeat")):
        stacked = dataset.arrays(history, pad=pad, **selection, view=view)
        windows = dataset.windows(history, pad=pad, **selection, view=view)
        order = np.random.default_rng(0).permutation(len(windows))
        assert len(windows) == len(stacked["rewards"])
        for name, values in windows.batch(order).items():
            assert (values == stacked[name][order]).all()


def test_imperfections_are_the_same_in_a_selection(whole):
    every = whole.arrays(view={"imperfections": TROUBLES})
    some = whole.arrays(view={"imperfections": TROUBLES}, policy="safe")
    kept = np.isin(every["episode"], some["episode"])
    assert (every["observations"][kept] == some["observations"]).all()
    assert not (every["observations"][:, :6] == whole.arrays()["observations"]).all(axis=0)[[1, 4, 5]].any()


def test_further_columns_come_with_the_arrays(without):
    arrays = without.arrays(view={"observe": "markov"}, columns=["action_log_prob", "policy", "latent_mu_v"])
    rows = without.to_pandas()[lambda rows: rows["step"] < 11]
    for name in ("action_log_prob", "policy", "latent_mu_v"):
        assert arrays[name].tolist() == rows[name].tolist()


def test_a_float64_dataset_is_viewed_as_float32(tmp_path):
    given = {**EXPERIMENT, "output": {"dtype": "float64", "latent": "next"}}
    exact = ibdata.generate(given, tmp_path / "made", workers=1)
    assert exact.arrays()["observations"].dtype == np.float64
    arrays = exact.arrays(view={"observe": "markov", "reward": {"consumption": 1, "fatigue": 3}})
    assert {arrays[name].dtype for name in ("observations", "actions", "rewards")} == {np.dtype(np.float32)}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"view": {"observe": ["latent_penalty"]}},
            "observe: found latent_penalty, expected columns of the dataset",
        ),
        ({"view": {"observe": ["latent_drift_rate"]}}, "observe: found latent_drift_rate, expected columns"),
        ({"columns": ["rewrad"]}, "column: found 'rewrad', .* did you mean 'reward'"),
    ],
    ids=["derived", "drift", "columns"],
)
def test_what_the_dataset_does_not_have_is_refused(whole, given, message):
    with pytest.raises(UsageError, match=message):
        whole.arrays(**given)


def test_batches_have_columns_or_a_view(whole):
    with pytest.raises(UsageError, match="columns: found columns beside a view"):
        whole.iter_batches(["reward"], view={"observe": "markov"})


def test_moving_setpoints_add_their_two_hidden_variables(tmp_path):
    given = {**EXPERIMENT, "setpoints": "drifting", "output": {"latent": "next"}}
    moving = ibdata.generate(given, tmp_path / "made", workers=1)
    assert moving.arrays(view={"observe": "markov"})["observations"].shape == (48, 22)
