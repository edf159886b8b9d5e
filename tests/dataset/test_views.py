"""Views of a dataset: the same values as its columns, whatever way they are read."""

import numpy as np
import pyarrow as pa
import pytest

from ibdata.errors import UsageError
from ibdata.views.options import view_options

pytestmark = pytest.mark.portable

TROUBLES = {
    "delay": {"obs_fatigue": 3},
    "noise": {"obs_consumption": 2.0},
    "missing": {"obs_velocity": 0.2},
    "mask": True,
}
MARKOV = {"observe": "markov"}


@pytest.fixture(scope="module")
def make(made_at, tmp_path_factory):
    """A function that makes a dataset of eight short episodes."""
    plain = {"name": "viewed", "setpoints": [20.0, 70.0], "policies": ["random", "safe"], "episodes": 2}

    def made(**changes):
        folder = tmp_path_factory.mktemp("viewed") / "made"
        return made_at({**plain, "steps": 12, "output": {"shard_rows": 30}, **changes}, folder)

    return made


@pytest.fixture(scope="module")
def without(make):
    """A dataset without the latent state after the last row."""
    return make()


@pytest.fixture(scope="module")
def whole(make):
    return make(output={"shard_rows": 30, "latent": "next"})


def test_markov_frames_are_the_columns_in_their_order(whole):
    frame = view_options("markov").frame(drifting=False)
    arrays, rows = whole.arrays(view=MARKOV), whole.to_pandas()
    assert (arrays["observations"] == rows[list(frame)].to_numpy()).all()
    assert (arrays["next_observations"] == rows[[f"next_{name}" for name in frame]].to_numpy()).all()


def test_last_rows_without_a_next_state_are_left_out(whole, without):
    found, expected = (d.arrays(view=MARKOV, history=3) for d in (without, whole))
    kept = expected["step"] < 11
    for name in found.keys() - {"truncated"}:
        assert (found[name] == expected[name][kept]).all()
    assert found["truncated"].tolist() == (found["step"] == 10).tolist()
    assert without.windows(view=MARKOV).left_out == 8
    assert whole.windows(view=MARKOV).left_out == 0
    more = ["action_log_prob", "policy", "latent_mu_v"]
    arrays = without.arrays(view=MARKOV, columns=more)
    rows = without.to_pandas()[lambda rows: rows["step"] < 11]
    for name in more:
        assert arrays[name].tolist() == rows[name].tolist()


def test_previous_actions_are_of_the_row_before_or_zero(whole):
    arrays = whole.arrays(view={"actions": True}, history=2)
    frames, after = (arrays[name].reshape(-1, 2, 9) for name in ("observations", "next_observations"))
    assert (after[:, 0, 6:] == arrays["actions"]).all()
    begun = arrays["step"] > 0
    assert (frames[begun, 0, 6:] == arrays["actions"][:-1][begun[1:]]).all()
    assert (frames[~begun][:, :, 6:] == 0).all()


@pytest.mark.parametrize(
    ("which", "selection", "view"),
    [
        ("without", {}, {"observe": "markov", "actions": True}),
        ("whole", {"policy": "safe"}, {"imperfections": TROUBLES, "reward": "delta"}),
        ("without", {}, {"observe": ["latent_mu_v", "obs_gain"], "reward": {"fatigue": 1}}),
    ],
    ids=["markov", "troubles", "list"],
)
def test_arrays_batches_frames_and_windows_hold_the_same_values(request, which, selection, view):
    whole = request.getfixturevalue(which)
    dataset = whole.select(**selection)
    arrays = dataset.arrays(view=view)
    batches = pa.Table.from_batches(list(dataset.iter_batches(batch_rows=7, view=view)))
    frame = dataset.windows(view=view).frame
    for prefix, name in (("", "observations"), ("next_", "next_observations")):
        columns = [batches[f"{prefix}{column}"].to_numpy() for column in frame]
        assert (np.stack(columns, axis=1) == arrays[name]).all()
    for column, name in (("reward", "rewards"), ("truncated", "truncated"), ("episode", "episode")):
        assert (batches[column].to_numpy() == arrays[name]).all()
    seen = dataset.to_pandas(view=view)
    assert (seen["reward"] == arrays["rewards"]).all()
    assert whole.to_pandas().loc[seen.index][["episode", "step"]].equals(seen[["episode", "step"]])
    for history, pad in ((1, "repeat"), (5, "drop"), (40, "repeat")):
        stacked = dataset.arrays(history, pad=pad, view=view)
        windows = dataset.windows(history, pad=pad, view=view)
        order = np.random.default_rng(0).permutation(len(windows))
        assert len(windows) == len(stacked["rewards"])
        for name, values in windows.batch(order).items():
            assert (values == stacked[name][order]).all()


def test_imperfections_are_the_same_in_a_selection(whole):
    every = whole.arrays(view={"imperfections": TROUBLES})
    some = whole.select(policy="safe").arrays(view={"imperfections": TROUBLES})
    kept = np.isin(every["episode"], some["episode"])
    assert (every["observations"][kept] == some["observations"]).all()
    assert not (every["observations"][:, :6] == whole.arrays()["observations"]).all(axis=0)[[1, 4, 5]].any()


def test_what_the_dataset_does_not_have_is_refused(whole):
    for name in ("latent_penalty", "latent_drift_rate"):
        with pytest.raises(UsageError, match=f"observe: found {name}, expected columns of the dataset"):
            whole.arrays(view={"observe": [name]})
    with pytest.raises(UsageError, match="column: found 'rewrad'; did you mean 'reward'"):
        whole.arrays(columns=["rewrad"])
    with pytest.raises(UsageError, match="columns: found columns beside a view"):
        whole.iter_batches(["reward"], view=MARKOV)
