"""What people do with `evaluate`: a row says what somebody does in a normal year, and what is right."""

from __future__ import annotations

import functools
from typing import ClassVar, Literal

import numpy as np
import pytest

import ibdata
from ibdata import evaluate
from ibdata.errors import UsageError
from ibdata.policies import Decision, Needs, Policy

pytestmark = pytest.mark.portable

BURN_IN = {"burn_in": [2, 9]}
UNSEEN = {"imperfections": {"missing": {"obs_gain": 1e-300}}}  # which never happens
WORLDS = {
    "siemens": {"setpoint": 70},
    "paper": {"setpoint": [20, 70], "dynamics": "paper"},
    "moving": {"setpoint": "drifting"},
    "moving, paper": {"setpoint": {"drifting": [5, 95]}, "dynamics": "paper"},
}
EPISODES, STEPS = 13, 12
SHORT = {"episodes": EPISODES, "steps": STEPS}


class Looking:
    """Acts by all frames that it sees, and keeps those of the first step."""

    def __init__(self, history, columns=6):
        self.shape, self.first = (history, columns), None

    def predict(self, observations):
        frames = observations.reshape(len(observations), *self.shape)
        if len(frames) == EPISODES and self.first is None:
            self.first = frames.copy()
        ages = np.arange(1, self.shape[0] + 1)
        return np.cos(np.einsum("nhc,h->nc", frames[..., 1:4], ages))


def first_frames(history, columns=6, **settings):
    """What an object sees at the first step (episodes, history, columns)."""
    seen = Looking(history, columns)
    evaluate(seen, history=history, episodes=EPISODES, steps=1, **settings)
    return seen.first


@pytest.mark.parametrize("world", WORLDS.values(), ids=WORLDS)
@pytest.mark.parametrize("start", ["uniform", BURN_IN], ids=["uniform", "burn-in"])
def test_a_view_that_shows_the_same(world, start):
    """Somebody adds a view that changes nothing to a history. The returns are the same."""
    plain = evaluate(Looking(5), history=5, start=start, **world, **SHORT)
    viewed = evaluate(Looking(5), history=5, start=start, view=UNSEEN, **world, **SHORT)
    np.testing.assert_array_equal(viewed.returns, plain.returns)


@pytest.mark.parametrize("world", WORLDS.values(), ids=WORLDS)
def test_the_frames_of_a_burn_in(world):
    """Somebody looks at the first history after a burn-in. It has its frames, in the columns of the view."""
    if isinstance(world["setpoint"], list):
        world = {**world, "setpoint": world["setpoint"][0]}
    plain = first_frames(12, start=BURN_IN, **world)
    viewed = first_frames(12, 9, start=BURN_IN, view={"actions": True}, **world)
    np.testing.assert_array_equal(viewed[..., :6], plain)
    moved = (plain[:, :-1] != plain[:, 1:]).any(axis=2)
    assert (moved.sum(axis=1) >= 2).all()
    assert len(set(moved.sum(axis=1).tolist())) > 3
    assert (moved[:, 9:] == 0).all()  # before the longest burn-in, its first frame is repeated
    before, after, action = viewed[:, 2:, 1], viewed[:, 1:-1, 1], viewed[:, 1:-1, 6]
    np.testing.assert_allclose(np.clip(before + action, 0, 100), after, atol=1e-4)
    assert (viewed[:, 0, 6:] == 0).all()  # as in the first row of arrays


def test_a_burn_in_of_no_step_among_longer_ones():
    """Somebody lets the burn-in be as short as 0. Where it is, the first frame is repeated."""
    repeats = lambda frames: (frames == frames[:, :1]).all(axis=(1, 2))  # noqa: E731
    plain = first_frames(4, start={"burn_in": [0, 2]})
    noisy = first_frames(4, start={"burn_in": [0, 2]}, view={"imperfections": {"noise": {"obs_fatigue": 3}}})
    assert 0 < repeats(plain).sum() < EPISODES
    np.testing.assert_array_equal(repeats(noisy), repeats(plain))
    np.testing.assert_array_equal(noisy[..., :4], plain[..., :4])


def test_late_measurements_of_a_burn_in():
    """Somebody lets fatigue be 2 steps late. The frames of the burn-in are, and the first row is not."""
    plain = first_frames(12, start=BURN_IN)
    late = first_frames(12, start=BURN_IN, view={"imperfections": {"delay": {"obs_fatigue": 2}}})
    np.testing.assert_array_equal(np.delete(late, 4, axis=2), np.delete(plain, 4, axis=2))
    np.testing.assert_array_equal(late[:, 0], plain[:, 0])
    np.testing.assert_array_equal(late[:, 1:10, 4], plain[:, 3:, 4])


def test_missing_measurements_of_a_burn_in():
    """Somebody lets velocity get lost. What is lost is what was seen before; the first row arrives."""
    troubles = {"missing": {"obs_velocity": 0.5}, "mask": True}
    plain = first_frames(12, start=BURN_IN)
    seen = first_frames(12, 7, start=BURN_IN, view={"imperfections": troubles})
    lost = seen[..., 6] == 1
    assert not lost[:, [0, -1]].any()
    assert 0.2 < lost[:, 1:4].mean() < 0.8
    np.testing.assert_array_equal(seen[~lost][:, :6], plain[~lost])
    np.testing.assert_array_equal(seen[:, :-1, 1][lost[:, :-1]], seen[:, 1:, 1][lost[:, :-1]])


def test_noisy_measurements_of_a_burn_in():
    """Somebody adds noise. That of the burn-in is another one, and that of the first row stays as it was."""
    noise = {"imperfections": {"noise": {"obs_gain": 1.0, "obs_consumption": 1.0}}}
    settings = {"start": BURN_IN, "view": noise}
    added = first_frames(12, **settings) - first_frames(12, start=BURN_IN)
    assert (added[:, :3, 2] != 0).all()
    assert 0.7 < added[:, :3, [2, 5]].std() < 1.3
    assert (abs(added[:, 0, 2] - added[:, -1, 2]) > 1e-3).all()  # at the first step of the burn-in
    np.testing.assert_array_equal(first_frames(1, **settings)[:, 0], first_frames(12, **settings)[:, 0])
    again = first_frames(12, **settings)
    np.testing.assert_array_equal(again, first_frames(12, **settings))


def test_the_memory_of_a_burn_in_is_as_long_as_the_history():
    """Somebody takes more frames. The newest ones stay as they are."""
    settings = {"start": BURN_IN, "setpoint": "drifting"}
    settings["view"] = {"observe": "markov", "imperfections": {"noise": {"latent_mu_v": 0.1}}}
    np.testing.assert_array_equal(first_frames(3, 22, **settings), first_frames(8, 22, **settings)[:, :3])


def test_a_note_that_training_did_not_see_the_burn_in():
    """Somebody trains on histories of a dataset, and evaluates after a burn-in. A note says what differs."""
    said = evaluate(Looking(5), history=5, start=BURN_IN, **SHORT).notes
    assert any("show the burn-in" in note for note in said)
    quiet = [
        evaluate(Looking(5), history=5, **SHORT),
        evaluate(Looking(1), start=BURN_IN, **SHORT),
        evaluate("expert", start=BURN_IN, **SHORT),
    ]
    assert not any("burn-in" in note for found in quiet for note in found.notes)


def test_called_twice():
    """Somebody calls it twice with one object. The returns are the same bits."""
    policy = Looking(3)
    first, second = (evaluate(policy, history=3, start=BURN_IN, view=UNSEEN, **SHORT) for _ in range(2))
    np.testing.assert_array_equal(first.returns, second.returns)


def test_in_a_loop_over_setpoints():
    """Somebody evaluates each setpoint in a call of its own. The returns are those of one call."""
    together = evaluate("optimized", [20, 70], start=BURN_IN, **SHORT).returns[0]
    alone = [evaluate("optimized", p, start=BURN_IN, **SHORT).returns[0, 0] for p in (70, 20)]
    np.testing.assert_array_equal(together, alone[::-1])


def test_setpoints_in_another_order():
    """Somebody gives setpoints from high to low. Each result is that of its setpoint."""
    there = evaluate("optimized", [70.0, 20.0], **SHORT)
    back = evaluate("optimized", [20, 70], **SHORT)
    rows = {result.setpoint: result.mean_return for result in there.results}
    assert rows == {result.setpoint: result.mean_return for result in back.results}


def test_more_episodes_later():
    """Somebody adds episodes to a small evaluation. The first ones stay as they are."""
    few = evaluate(Looking(3), history=3, start=BURN_IN, view=UNSEEN, steps=STEPS, episodes=5).returns
    many = evaluate(Looking(3), history=3, start=BURN_IN, view=UNSEEN, steps=STEPS, episodes=300).returns
    np.testing.assert_array_equal(many[..., :5], few)


def test_policies_in_another_order():
    """Somebody lists policies in another order. Each has its returns."""
    one = evaluate(["safe", Looking(2)], history=2, **SHORT).returns
    other = evaluate([Looking(2), "safe"], history=2, **SHORT).returns
    np.testing.assert_array_equal(one, other[::-1])


def test_the_same_policy_under_two_labels():
    """Somebody compares a policy with itself. The difference is 0."""
    found = evaluate({"old": Looking(2), "new": Looking(2)}, history=2, start=BURN_IN, **SHORT)
    assert [result.policy for result in found.results] == ["old", "new"]
    np.testing.assert_array_equal(*found.returns)


def test_a_view_among_policies_that_see_none():
    """Somebody compares an object that sees a view with a policy of ibdata, which does not."""
    view = {"observe": ["obs_velocity", "obs_gain", "obs_shift", "latent_mu_v"]}
    both = evaluate(["optimized", Looking(2, 4)], history=2, start=BURN_IN, view=view, **SHORT)
    np.testing.assert_array_equal(both.returns[0], evaluate("optimized", start=BURN_IN, **SHORT).returns[0])


def test_an_object_behind_a_wrapper():
    """Somebody wraps an object in a function, a partial and a class. The returns are the same."""
    inner, settings = Looking(3), {"history": 3, "start": BURN_IN, **SHORT}

    class Wrapper:
        def __init__(self, wrapped):
            self.wrapped = wrapped

        def predict(self, observations):
            return self.wrapped.predict(observations)

    expected = evaluate(inner, **settings).returns
    for wrapped in (lambda seen: inner.predict(seen), functools.partial(inner.predict), Wrapper(inner)):
        np.testing.assert_array_equal(evaluate(wrapped, **settings).returns, expected)


def test_an_object_that_changes_what_it_is_given():
    """Somebody scales observations in place. The next steps see the true ones."""

    def in_place(observations):
        observations /= 100.0
        return observations[:, 1:4]

    def copied(observations):
        return (observations / np.float32(100.0))[:, 1:4]

    for view in (None, {**UNSEEN}):
        found = [
            evaluate(f, history=3, start=BURN_IN, view=view, **SHORT).returns for f in (in_place, copied)
        ]
        np.testing.assert_array_equal(*found)


class Summing(Policy):
    """A class of a user, whose needs say what it sees."""

    needs: ClassVar[Needs] = Needs(history=4)

    kind: Literal["summing"] = "summing"

    def decide(self, observed):
        seen = observed.observations[..., 1:4].astype(np.float64)
        return Decision(np.cos(seen.sum(axis=1)), observed.memory)


def test_a_subclass_and_an_object_that_do_the_same():
    """Somebody writes a subclass of `Policy`, and later a function. Both see the burn-in."""

    def same(observations):
        frames = observations.reshape(len(observations), 4, 6)
        return np.cos(frames[..., 1:4].astype(np.float64).sum(axis=1))

    first = evaluate(Summing(), start=BURN_IN, **SHORT).returns
    np.testing.assert_array_equal(first, evaluate(same, history=4, start=BURN_IN, **SHORT).returns)


def test_a_history_for_each_label():
    """Somebody gives histories by label. Each object sees its own."""
    found = evaluate({"a": Looking(2), "b": Looking(5)}, history={"a": 2, "b": 5}, start=BURN_IN, **SHORT)
    for i, history in enumerate((2, 5)):
        alone = evaluate(Looking(history), history=history, start=BURN_IN, **SHORT)
        np.testing.assert_array_equal(found.returns[i], alone.returns[0])


def test_a_history_for_a_policy_that_sets_its_own():
    """Somebody gives a history to a policy of ibdata. It is refused, because nobody would see it."""
    with pytest.raises(UsageError, match="history: found 5, but no object that could see so many"):
        evaluate("optimized", history=5, **SHORT)


def test_a_view_without_an_object():
    """Somebody gives a view to policies of ibdata. It is refused, because nobody would see it."""
    with pytest.raises(UsageError, match="view: found one, but no object that could see it"):
        evaluate("optimized", view=UNSEEN, **SHORT)


def test_the_setpoint_by_which_a_moving_one_counts(tmp_path):
    """Somebody selects by a setpoint that moves in a burn-in. It is that of the experiment, not of a row."""
    experiment = {
        "name": "x",
        "policies": ["random"],
        "episodes": 6,
        "steps": 2,
        "start": {"burn_in": [30, 40]},
    }
    experiment["setpoints"] = {"drifting": [30, 80]}
    ds = ibdata.generate(experiment, tmp_path / "made", workers=1)
    chosen = ds.select(setpoint=30)
    assert chosen.episodes["episode"].tolist() == list(range(6))
    assert not np.isclose(chosen.to_pandas().groupby("episode")["obs_setpoint"].first(), 30).all()


def test_costs_beside_a_view_after_a_burn_in():
    """Somebody counts costs with a view and without. The counts are the same."""
    cost = {"fatigue": 30, "budget": 2}
    settings = {"history": 3, "start": BURN_IN, **SHORT}
    plain = evaluate(Looking(3), view={"cost": cost}, **settings).results[0]
    viewed = evaluate(Looking(3), view={"cost": cost, **UNSEEN}, **settings).results[0]
    assert (viewed.mean_cost, viewed.violations) == (plain.mean_cost, plain.violations)
    assert plain.mean_cost > 0


def test_the_setpoints_of_a_table_as_numbers_of_python(tmp_path):
    """A loop over groups of a table hands back floats that came from float32: they mean their decimals."""
    plain = {"name": "x", "setpoints": [70.3, 20], "policies": ["random"], "steps": 3}
    table = ibdata.generate(plain, tmp_path / "x", workers=1).episodes
    for setpoint in sorted(set(table["setpoint"].tolist())):
        [result] = ibdata.evaluate("random", setpoint, episodes=3, steps=3).results
        [right] = ibdata.evaluate("random", round(setpoint, 1), episodes=3, steps=3).results
        assert result == right
