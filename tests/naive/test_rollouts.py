"""What people do with `rollouts`: a row says what somebody does in a normal year, and what is right."""

from __future__ import annotations

import numpy as np
import pytest

import ibdata
from ibdata.dynamics import SIEMENS, Noise, State, initial_state, step
from ibdata.environment.replayed import Replay
from ibdata.environment.settings import settings
from ibdata.environment.simulation import Lane, Simulation
from ibdata.errors import UsageError

pytestmark = pytest.mark.portable

ACTIONS = ["act_velocity", "act_gain", "act_shift"]
PLAIN = {"policies": [{"kind": "random"}], "setpoints": [70], "episodes": 4, "steps": 50}
OTHERS = {"dynamics": "paper", "setpoints": {"drifting": [20, 95]}, "start": {"burn_in": [3, 20]}}
DELAYED = {"imperfections": {"delay": {"obs_fatigue": 3, "obs_shift": 1}}}
IMPERFECT = {
    "observe": ["obs_fatigue", "obs_gain", "obs_consumption"],
    "actions": True,
    "imperfections": {
        "delay": {"obs_fatigue": 2, "obs_gain": 5},
        "noise": {"obs_fatigue": 1.0, "obs_consumption": 2.0},
        "missing": {"obs_fatigue": 0.3, "obs_consumption": 0.9},
        "quantise": {"obs_gain": 0.5},
        "mask": True,
    },
}


def made_of(folder, **changes):
    return ibdata.generate({"name": folder.name, **PLAIN, **changes}, folder, workers=1)


@pytest.fixture(scope="module")
def ds(tmp_path_factory):
    return made_of(tmp_path_factory.mktemp("naive") / "plain")


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    return made_of(tmp_path_factory.mktemp("naive") / "moving", **OTHERS)


def sequences(*shape, seed=1):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (*shape, 3))


def draws(state):
    """The normal numbers (n,) behind the consumption of a state of `siemens`."""
    expected = state.expected_consumption
    return (state.consumption - expected) / (1.0 + SIEMENS.consumption_noise * expected)


def correlated(x, y):
    """Whether the correlation of independent numbers (n,) would be so far from 0 once in 15,000 times."""
    return abs(np.corrcoef(x, y)[0, 1]) > 4 / np.sqrt(len(x))


def copies(ds, n):
    return ibdata.state_at(ds, (np.zeros(n, int), 20))


def test_a_closed_loop_over_states(ds):
    """Somebody plays the state that a call returned, step by step. Each step has noise of its own."""
    state, seen = copies(ds, 500), []
    for _ in range(6):
        state = ibdata.rollouts(state, np.zeros((1, 1, 3))).state
        seen.append(draws(state))
    assert not any(correlated(seen[i], seen[j]) for i in range(6) for j in range(i))
    assert abs(np.concatenate(seen).std() - 1) < 0.06


def test_many_copies_of_one_state(ds):
    """Somebody starts 500 lanes in one state, in place of `samples`. Their noise is independent."""
    made = ibdata.rollouts(copies(ds, 500), np.zeros((1, 2, 3)))
    assert len(np.unique(made.rewards[:, 0, 0, 0])) > 490  # as float32, some may be equal
    first = draws(ibdata.rollouts(copies(ds, 500), np.zeros((1, 1, 3))).state)
    assert not correlated(first[:-1], first[1:])
    assert abs(first.mean()) < 4 / np.sqrt(500)


def test_rows_in_pieces_and_in_another_order(ds):
    """Somebody plays rows one by one, or shuffled. Each row has the noise that it has among the others."""
    rows, actions = np.array([0, 17, 60, 121, 199]), sequences(2, 8)
    made = ibdata.rollouts(ds, actions, rows=rows, samples=3)
    for i, row in enumerate(rows):
        np.testing.assert_array_equal(
            ibdata.rollouts(ds, actions, rows=row, samples=3).rewards[0], made.rewards[i]
        )
    back = ibdata.rollouts(ds, actions, rows=rows[::-1], samples=3)
    np.testing.assert_array_equal(back.rewards[::-1], made.rewards)


def test_rows_one_by_one_have_independent_noise(ds):
    """Somebody plays each row in a call of its own, as memory asks. Their errors are not the same."""
    one = [ibdata.rollouts(ds, np.zeros((1, 1, 3)), rows=(0, 5 * i), samples=400).state for i in range(4)]
    assert not any(correlated(draws(one[i]), draws(one[j])) for i in range(4) for j in range(i))


def test_one_row_by_any_name(ds):
    """Somebody names a row by number, pair, table, arrays, or state. It is one start, with one noise."""
    rows, arrays, actions = ds.to_pandas(), ds.arrays(), sequences(1, 5)
    expected = ibdata.rollouts(ds, actions, rows=73, samples=2).rewards
    picked = {name: arrays[name][[73]] for name in ("episode", "step")}
    for same in ((1, 23), np.array([[1, 23]]), rows[73:74], picked):
        np.testing.assert_array_equal(ibdata.rollouts(ds, actions, rows=same, samples=2).rewards, expected)
    state = ibdata.state_at(ds, 73)
    np.testing.assert_array_equal(ibdata.rollouts(state, actions, samples=2).rewards, expected)


def test_all_rows_of_the_arrays_at_once(ds):
    """Somebody gives the arrays as the rows. Their actions give their rewards and observations again."""
    arrays = ds.arrays(split=None)
    made = ibdata.rollouts(ds, arrays["actions"][:, None, None], rows=arrays, noise="recorded")
    np.testing.assert_array_equal(made.rewards[:, 0, 0, 0], arrays["rewards"])
    np.testing.assert_array_equal(made.observations[:, 0, 0, 0], arrays["next_observations"])


def test_a_view_with_fewer_rows(ds):
    """Somebody takes rows of arrays that leave some out. Episode and step name them, not their place."""
    arrays = ds.arrays(history=4, pad="drop")
    some = np.array([0, 50, 120])
    rows = {name: arrays[name][some] for name in ("episode", "step")}
    made = ibdata.rollouts(ds, arrays["actions"][some][:, None, None], rows=rows, noise="recorded")
    np.testing.assert_array_equal(made.rewards[:, 0, 0, 0], arrays["rewards"][some])


@pytest.mark.parametrize("rows", [np.arange(200) < 3, -1, [3, 10], 200, 0.0])
def test_rows_that_are_none(ds, rows):
    """Somebody gives a mask, counts from the end, or past it. It is refused."""
    with pytest.raises(UsageError, match=r"found .*expected"):
        ibdata.rollouts(ds, np.zeros((1, 1, 3)), rows=rows)


def test_a_selection(ds):
    """Somebody counts rows in a selection. It is refused: they are counted in the dataset."""
    with pytest.raises(UsageError, match=r"selection"):
        ibdata.rollouts(ds.select(episodes=[2]), np.zeros((1, 1, 3)), rows=0)


@pytest.mark.parametrize("noise", [{}, {"noise": 3}], ids=["default", "noise=3"])
def test_sequences_in_pieces(ds, moving, noise):
    """Somebody plays a long sequence in pieces by earlier rollouts. It is as in one call, bit for bit."""
    for start in ({"start": ds, "rows": [3, 70, 71]}, {"start": moving, "rows": [3, 70, 71]}):
        actions = sequences(2, 40)
        whole = ibdata.rollouts(**start, actions=actions, samples=2, **noise)
        made = ibdata.rollouts(**start, actions=actions[:, :7], samples=2, **noise)
        for first, stop in ((7, 8), (8, 40)):
            lanes = np.repeat(np.tile(actions[:, None, first:stop], (3, 1, 1, 1)), 2, axis=0)[:, None]
            made = ibdata.rollouts(made, lanes.reshape(12, 1, stop - first, 3), **noise)
        np.testing.assert_array_equal(made.rewards[:, 0, 0].reshape(3, 2, 2, 32), whole.rewards[..., 8:])
        np.testing.assert_array_equal(made.state.values, whole.state.values)


def test_going_on_twice(ds):
    """Somebody goes on twice from the same rollouts. These are unchanged, and the noise is one."""
    made = ibdata.rollouts(ds, sequences(1, 3), rows=np.array([3, 4]), samples=2)
    before = made.state.values.copy()
    one, two = (ibdata.rollouts(made, sequences(1, 4, seed=i)).state for i in range(2))
    np.testing.assert_array_equal(made.state.values, before)
    np.testing.assert_allclose(draws(one), draws(two), atol=1e-9)


def test_going_on_without_naming_the_view(ds):
    """Somebody scales the rewards once, then goes on: the view stays, and so does a state that was edited."""
    zeros, scaled = np.zeros((1, 2, 3)), {"reward_scale": 0.01}
    made = ibdata.rollouts(ds, zeros, rows=[0], view=scaled)
    unnamed, named, plain = (ibdata.rollouts(made, zeros, view=view).rewards for view in (None, scaled, {}))
    assert np.array_equal(unnamed, named)
    np.testing.assert_allclose(plain, unnamed * 100, rtol=1e-5)
    edited = made._replace(state=made.state.replace(velocity=[99.0]))
    assert ibdata.rollouts(edited, zeros).state.velocity.tolist() == [99.0]


def test_going_on_from_recorded_noise_with_a_seed(ds):
    """The episode's own noise ends where a seed is given: what follows is the start's own noise."""
    first, last = (ibdata.rollouts(ds, np.zeros((1, 1, 3)), rows=[row], noise="recorded") for row in (0, 120))
    for made in (first, last):
        assert ibdata.rollouts(made, np.zeros((1, 2, 3)), noise=3).lanes.index.tolist() == [0]


def test_two_policies_in_a_loop(ds):
    """Somebody compares two policies in loops from one start. They stay paired; each step has new noise."""
    seen = []
    for towards in (20, 80):
        made, states = ibdata.rollouts(ds, np.zeros((1, 1, 3)), rows=np.arange(0, 200, 2)), []
        for _ in range(5):
            state = made.state
            steering = np.stack([state.velocity, state.gain, state.shift], axis=1)
            made = ibdata.rollouts(made, np.sign(towards - steering)[:, None, None])
            states.append(draws(made.state))
        seen.append(np.array(states))
    np.testing.assert_allclose(seen[0], seen[1], atol=1e-9)
    assert not any(correlated(seen[0][i], seen[0][j]) for i in range(5) for j in range(i))


def test_two_policies_in_one_call(ds):
    """Somebody plays two sequences, and goes on from both. They stay paired."""
    made = ibdata.rollouts(ds, sequences(2, 3), rows=np.array([10, 90]), samples=3)
    later = ibdata.rollouts(made, np.zeros((1, 4, 3))).state
    by_sequence = draws(later).reshape(2, 2, 3)
    np.testing.assert_allclose(by_sequence[:, 0], by_sequence[:, 1], atol=1e-9)
    assert len(np.unique(by_sequence[:, 0].round(9))) == 6


def test_more_samples_of_earlier_rollouts(ds):
    """Somebody branches off earlier rollouts. Each branch has its own noise; the first is what comes."""
    made = ibdata.rollouts(ds, np.zeros((1, 2, 3)), rows=(0, 9), samples=3)
    branched = ibdata.rollouts(made, np.zeros((1, 1, 3)), samples=4)
    further = draws(ibdata.rollouts(branched, np.zeros((1, 1, 3)), samples=2).state)
    assert len(np.unique(draws(branched.state).round(9))) == 12
    assert len(np.unique(further.round(9))) == 24
    alone = ibdata.rollouts(made, np.zeros((1, 1, 3)))
    np.testing.assert_array_equal(branched.rewards[:, :, :1], alone.rewards)


def test_seeds_of_replications(ds):
    """Somebody gives each replication a seed in its first call only. It is another one to its end."""
    ends = []
    for noise in range(3):
        made = ibdata.rollouts(ds, np.zeros((1, 1, 3)), rows=np.arange(100), noise=noise)
        made = ibdata.rollouts(ibdata.rollouts(made, np.zeros((1, 1, 3))), np.zeros((1, 1, 3)))
        ends.append(draws(made.state))
    assert not any(correlated(ends[i], ends[j]) for i in range(3) for j in range(i))


@pytest.mark.parametrize("start", ["state", "rollouts"])
def test_a_planner(ds, start):
    """Somebody plans by rollouts and plays the plan. With another `noise` it does not see what will come."""
    now = ibdata.rollouts(ds, np.zeros((1, 1, 3)), rows=np.arange(200))
    now = now.state if start == "state" else now
    zero = np.zeros((1, 1, 3))
    planned, comes = ibdata.rollouts(now, zero, noise=1), ibdata.rollouts(now, zero)
    assert not correlated(draws(planned.state), draws(comes.state))
    assert correlated(draws(ibdata.rollouts(now, zero).state), draws(comes.state))


def test_the_recorded_noise_in_pieces(moving):
    """Somebody plays the recorded actions of an episode in pieces. They give its rows to their end."""
    rows = moving.to_pandas()[60:100]
    taken = rows[ACTIONS].to_numpy()
    made = ibdata.rollouts(moving, taken[None, :15], rows=(1, 10), noise="recorded")
    rest = ibdata.rollouts(made, taken[None, 15:])
    rewards = np.concatenate([made.rewards[0, 0, 0], rest.rewards[0, 0, 0]])
    np.testing.assert_array_equal(rewards, rows["reward"].to_numpy())
    with pytest.raises(UsageError, match=r"^noise: found 'recorded', expected a seed"):
        ibdata.rollouts(made, taken[None, 15:], samples=2)
    other = ibdata.rollouts(made, taken[None, 15:], noise=0, samples=2)
    assert (other.rewards != rest.rewards).any()


@pytest.mark.parametrize("view", [DELAYED, IMPERFECT], ids=["delayed", "imperfect"])
@pytest.mark.parametrize("world", ["ds", "moving"])
def test_an_imperfect_view_of_rows(request, world, view):
    """Somebody plays recorded actions through a view. Frames are those of arrays: they know the past."""
    given = request.getfixturevalue(world)
    arrays, some = given.arrays(view=view), np.array([0, 1, 2, 7, 33, 49, 50, 51, 120])
    made = ibdata.rollouts(
        given, arrays["actions"][some][:, None, None], rows=some, noise="recorded", view=view
    )
    np.testing.assert_array_equal(made.observations[:, 0, 0, 0], arrays["next_observations"][some])


@pytest.mark.parametrize("noise", ["recorded", 2])
def test_an_imperfect_view_in_pieces(ds, noise):
    """Somebody plays in pieces through a view with a memory. The frames are those of one call."""
    actions = sequences(1, 9)
    whole = ibdata.rollouts(ds, actions, rows=np.array([6, 60]), noise=noise, view=IMPERFECT)
    made = ibdata.rollouts(ds, actions[:, :4], rows=np.array([6, 60]), noise=noise, view=IMPERFECT)
    rest = ibdata.rollouts(made, actions[:, 4:], view=IMPERFECT)
    np.testing.assert_array_equal(rest.observations[:, 0], whole.observations[:, 0, :, 4:])
    for other in (made, ibdata.rollouts(ds, actions, rows=6)):
        with pytest.raises(
            UsageError, match=r"^view: found another view with imperfections, expected that of the earlier"
        ):
            ibdata.rollouts(other, actions, view=DELAYED)
    assert ibdata.rollouts(made, actions, view={}).observations.shape == (2, 1, 1, 9, 6)


def test_a_noisy_view_in_a_loop(ds):
    """Somebody looks at states in a loop through noisy measurements. Each step and lane has its own error."""
    view, state, errors = {"imperfections": {"noise": {"obs_setpoint": 1.0}}}, copies(ds, 300), []
    for _ in range(4):
        made = ibdata.rollouts(state, np.zeros((1, 1, 3)), view=view)
        errors.append(made.observations[:, 0, 0, 0, 0] - 70)
        state = made.state
    assert not any(correlated(errors[i], errors[j]) for i in range(4) for j in range(i))
    assert not correlated(errors[0][1:], errors[0][:-1])


@pytest.fixture(scope="module", params=["float32", "float64"])
def stored(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("naive") / request.param
    return made_of(folder, episodes=2, output={"dtype": request.param})


@pytest.mark.parametrize("scale", [1, 0.01, 3e5])
@pytest.mark.parametrize("reward", ["classic", "delta", {"consumption": 0.7, "fatigue": 2.2}], ids=str)
def test_a_scaled_reward(stored, reward, scale):
    """Somebody scales rewards. Arrays, environments and rollouts have the same, bit for bit."""
    view = {"reward": reward, "reward_scale": scale}
    arrays = stored.arrays(view=view)
    expected = arrays["rewards"].astype(np.float32).reshape(2, 50)
    actions = arrays["actions"].reshape(2, 1, 50, 3)
    made = ibdata.rollouts(stored, actions, rows=np.array([0, 50]), noise="recorded", view=view)
    np.testing.assert_array_equal(made.rewards[:, 0, 0], expected)
    lanes = Simulation(settings(setpoint=70, view=view), 2)
    lane = Lane(lanes.settings)
    noise = Replay.asked_for({"dataset": stored, "episode": [0, 1]}, lanes.settings, 2).begin(
        lanes, lanes.everyone
    )
    [own] = Replay.asked_for({"dataset": stored, "episode": 0}, lane.settings, 1).begin(lane, lane.everyone)

    def draw(which, purpose, step, steps, slots):
        return np.stack([noise[i].random_raw(slots) for i in which], axis=1)[None]

    for t in range(50):
        rewards = lanes.step(lanes.everyone, actions[:, 0, t], draw)
        np.testing.assert_array_equal(rewards.astype(np.float32), expected[:, t])
        _, reward, _ = lane.move(tuple(actions[0, 0, t].tolist()), own.random_raw(lane.draws))
        assert np.float32(reward) == expected[0, t]


def test_setpoints_alone_and_together():
    """Somebody starts at setpoints in one call or in several. Each start and its noise is the same."""
    actions, settings = sequences(1, 4), {"start": "uniform", "dynamics": "paper"}
    both = ibdata.rollouts({"setpoint": [20, 90], **settings}, actions, samples=2)
    for i, setpoint in enumerate([20, 90]):
        alone = ibdata.rollouts({"setpoint": setpoint, **settings}, actions, samples=2)
        np.testing.assert_array_equal(alone.observations[0], both.observations[i])
    assert (both.observations[0, ..., 1:4] != both.observations[1, ..., 1:4]).all()


def test_a_state_of_other_dynamics(ds, moving):
    """Somebody plays the state of a row of `paper` as `siemens`, or the reverse. It is refused."""
    paper, siemens, zero = (
        ibdata.state_at(moving, np.array([5, 60])),
        ibdata.state_at(ds, np.array([5, 60])),
        np.zeros((1, 3, 3)),
    )
    with pytest.raises(
        UsageError, match=r"^start: found a state of the dynamics paper, .*\(\"paper\", state\)"
    ):
        ibdata.rollouts(paper, zero)
    with pytest.raises(UsageError, match=r"^start: found a state of the dynamics siemens"):
        ibdata.rollouts(("paper", siemens), zero)
    right = ibdata.rollouts(moving, zero, rows=np.array([5, 60]))
    np.testing.assert_array_equal(ibdata.rollouts(("paper", paper), zero).rewards, right.rewards)
    quiet = Noise(*np.zeros((12, 2)))
    with pytest.raises(ValueError, match=r"^step: found a state of the dynamics paper, expected one of"):
        step(paper, np.zeros((2, 3)), quiet)
    assert step(paper, np.zeros((2, 3)), quiet, "paper").lanes == 2
    lanes = Simulation(settings(setpoint="drifting"), 2)
    with pytest.raises(UsageError, match=r"^set_state: found a state of the dynamics paper"):
        lanes.set_state(paper, lanes.everyone, lambda *address: np.zeros((1, 4, 2), np.uint64))


def test_a_state_of_no_dynamics():
    """Somebody starts where an episode begins, or in a state of their own. Both dynamics play it."""
    begun = initial_state([30.0, 70.0])  # of which no step is known
    own = begun.replace(operational_cost=np.full((2, 10), 80.0), mu_v=[0.5, 2.0])
    for state in (begun, own):
        one, other = (ibdata.rollouts((name, state), np.zeros((1, 3, 3))) for name in ("siemens", "paper"))
        assert (one.rewards != other.rewards).any()


def test_variants_of_the_dynamics(ds):
    """Somebody plays states of `siemens` in a variant. With another offset it is refused."""
    state, zero = ibdata.state_at(ds, np.array([5, 60])), np.zeros((1, 3, 3))
    calm = ({"base": "siemens", "eta_mean": 0.01}, state)
    assert (ibdata.rollouts(calm, zero).rewards != ibdata.rollouts(state, zero).rewards).any()
    with pytest.raises(UsageError, match=r"^start: found a state of the dynamics siemens"):
        ibdata.rollouts(({"base": "siemens", "consumption_offset": 3.0}, state), zero)


def test_constant_and_moving_setpoints_in_one_state():
    """Somebody joins states of both kinds. It is refused."""
    joined = State(np.hstack([initial_state(70).values, initial_state(70, drifting=True).values]))
    with pytest.raises(UsageError, match="all have constant setpoints, or all moving"):
        ibdata.rollouts(joined, np.zeros((1, 1, 3)))


def test_a_certain_column(ds):
    """Somebody asks how random a constant is. It is not, if the mean is taken in float64."""
    made = ibdata.rollouts(ds, np.zeros((1, 1, 3)), rows=100, samples=1000)
    assert made.observations[0, 0, :, 0].std(axis=0, dtype=float)[0] == 0
