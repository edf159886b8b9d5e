"""Hypothetical rollouts: what recorded actions give again, and what others would have given."""

import numpy as np
import pytest
from helpers.refusals import refused

import ibdata

ACTIONS = ["act_velocity", "act_gain", "act_shift"]
EXPERIMENTS = {
    "siemens, two setpoints": {"setpoints": [20, 70]},
    "burn-in, moving, paper": {
        "setpoints": {"drifting": [95]}, "dynamics": "paper", "start": {"burn_in": [3, 40]},
    },
}  # fmt: skip


@pytest.fixture(scope="module", params=EXPERIMENTS)
def dataset(request, tmp_path_factory):
    plain = {"name": "x", "policies": [{"kind": "random"}], "episodes": 5, "steps": 60}
    folder = tmp_path_factory.mktemp("rollouts") / "x"
    return ibdata.generate({**plain, **EXPERIMENTS[request.param]}, folder, workers=1)


def test_the_recorded_actions_give_the_row_again_bit_for_bit(dataset):
    rows = dataset.to_pandas()
    some = np.random.default_rng(0).integers(0, len(rows), 250)
    taken = rows.loc[some, ACTIONS].to_numpy()
    made = ibdata.rollouts(
        dataset, taken[:, None, None], rows=some, noise="recorded", view={"observe": "markov"}
    )
    columns = [name for name in rows if name.startswith("next_obs_")]
    assert np.array_equal(made.rewards[:, 0, 0, 0], rows.loc[some, "reward"].to_numpy())
    assert np.array_equal(made.observations[:, 0, 0, 0, :6], rows.loc[some, columns].to_numpy())


def test_the_rest_of_an_episode_is_played_again_under_other_actions(dataset):
    """The actions of the row are one of two sequences; the other one gives the counterfactual."""
    rows = dataset.to_pandas()
    episode, step, h = 3, 21, 35  # longer than a block
    first = int(np.flatnonzero((rows["episode"] == episode) & (rows["step"] == step))[0])
    taken = rows.loc[first : first + h - 1, ACTIONS].to_numpy()
    other = np.stack([taken, np.zeros_like(taken)])
    made = ibdata.rollouts(dataset, other, rows=(episode, step), noise="recorded")
    assert np.array_equal(made.rewards[0, 0, 0], rows.loc[first : first + h - 1, "reward"].to_numpy())
    assert (made.rewards[0, 1] != made.rewards[0, 0]).any()
    state = ibdata.state_at(dataset, (episode, step + h))
    assert np.array_equal(made.state.take(np.array([0])).values, state.values)


@pytest.fixture(scope="module")
def safe(tmp_path_factory):
    plain = {"name": "x", "setpoints": [70], "policies": [{"kind": "safe"}], "episodes": 2, "steps": 40}
    return ibdata.generate(plain, tmp_path_factory.mktemp("state") / "x", workers=1)


@pytest.fixture(scope="module")
def state(safe):
    return ibdata.state_at(safe, ([0, 0, 1], [0, 30, 30]))


def sequences(*shape):
    return np.random.default_rng(1).uniform(-1.0, 1.0, (*shape, 3))


def test_sequences_share_their_noise_and_samples_and_starts_do_not(state):
    same = np.repeat(sequences(1, 8), 2, axis=0)
    made = ibdata.rollouts(state, same, samples=3)
    assert made.rewards.shape == (3, 2, 3, 8)
    assert made.observations.shape == (3, 2, 3, 8, 6)
    assert np.array_equal(made.rewards[:, 0], made.rewards[:, 1])
    assert len(np.unique(made.rewards[:, 0, :, 0])) == 9
    again = ibdata.rollouts(state, same, samples=3)
    assert np.array_equal(again.observations, made.observations)
    assert (ibdata.rollouts(state, same, samples=3, noise=1).rewards != made.rewards).any()


def test_many_lanes_are_those_of_few(state):
    """However lanes are put together."""
    actions = sequences(3, 40, 35)
    together = ibdata.rollouts(state, actions, samples=4, view={"observe": "markov", "actions": True})
    assert together.observations.shape == (3, 40, 4, 35, 23)
    alone = ibdata.rollouts(state, actions[:, 7:8], samples=4)
    assert np.array_equal(together.rewards[:, 7:8], alone.rewards)
    assert np.array_equal(together.observations[:, 7:8, ..., :6], alone.observations)
    lane = np.array([(1 * 40 + 7) * 4 + 2])
    assert np.array_equal(together.state.take(lane).values, alone.state.take(np.array([1 * 4 + 2])).values)
    assert np.array_equal(
        together.observations[..., -3:], np.repeat(actions[:, :, None], 4, 2).astype(np.float32)
    )


def test_rollouts_go_on_and_the_mean_is_the_true_value_s(safe):
    """The mean of 4,000 samples and that of 4,000 branches differ by less than four standard errors."""
    known = ibdata.true_values(safe, (0, 30), "constant", steps=20, discount=1.0, episodes=4000)
    first = ibdata.rollouts(safe, np.zeros((1, 5, 3)), rows=(0, 30), samples=4000)
    rest = ibdata.rollouts(first, np.zeros((1, 15, 3)))
    returns = first.rewards[0, 0].sum(axis=1) + rest.rewards[:, 0, 0].sum(axis=1)
    error = np.hypot(known.standard_errors[0], returns.std() / np.sqrt(4000))
    assert abs(returns.mean() - known.values[0]) < 4 * error


def test_starts_are_settings_or_states_of_other_dynamics(state):
    actions = sequences(2, 3)
    made = ibdata.rollouts({"setpoint": [20, 90], "start": "uniform"}, actions, samples=2)
    assert made.rewards.shape == (2, 2, 2, 3)
    assert made.observations[:, 0, 0, 0, 0].tolist() == [20.0, 90.0]
    calm = ibdata.rollouts(({"base": "siemens", "eta_mean": 0.01}, state), actions)
    assert (calm.rewards != ibdata.rollouts(state, actions).rewards).any()


def test_views_see_and_reward_as_everywhere(state):
    actions = sequences(2, 6)
    noisy = {"imperfections": {"noise": {"obs_fatigue": 1.0}}}
    same = ibdata.rollouts(state, actions[[0, 0]], samples=2, view=noisy).observations
    assert np.array_equal(same[:, 0], same[:, 1])
    assert (same[:, :, 0, :, 4] != same[:, :, 1, :, 4]).all()
    view = {"reward": "delta", "reward_scale": 0.1, "imperfections": {"delay": {"obs_fatigue": 2}}}
    plain, seen = ibdata.rollouts(state, actions), ibdata.rollouts(state, actions, view=view)
    fatigue = plain.observations[..., 4]
    assert np.array_equal(seen.observations[..., 2:, 4], fatigue[..., :-2])
    assert seen.rewards[..., 1:] == pytest.approx(0.1 * np.diff(plain.rewards), abs=1e-3)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"actions": np.zeros((2, 3))}, r"^actions: found .*expected \(k, h, 3\) or \(3, k, h, 3\) finite"),
        ({"actions": np.zeros((2, 1, 1, 3))}, "^actions: found"),
        ({"actions": [[[np.nan, 0, 0]]]}, "^actions: found"),
        ({"noise": "recorded"}, "^noise: found 'recorded', expected a seed .*, or 'recorded' with rows of"),
        ({"samples": 0}, "^samples: found 0, expected at least 1"),
        ({"start": 5}, "^start: found 5, expected a dataset with rows=, a State, or settings"),
        ({"samples": 10**12}, "^samples: "),
        ({"start": {"setpoint": 70, "seed": 1}}, "^start: found seed, expected"),
        ({"noise": -1}, "^noise: found -1, expected a seed in "),
        ({"actions": np.zeros((1, 1, 3), complex)}, "^actions: found"),
        ({"view": {"cost": "runaway"}}, "^view: found a cost"),
    ],
)
def test_what_cannot_be_played_is_refused(state, options, said):
    refused(said, ibdata.rollouts, **{"start": state, "actions": np.zeros((1, 1, 3)), **options})
