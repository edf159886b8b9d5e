"""Evaluation: returns, their random numbers, differences, scores and errors."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest
from helpers.watching import Watching

from ibdata import evaluate, generate
from ibdata.dataset.reference_returns import scale
from ibdata.dynamics import VARIANTS, Noise, initial_state, step
from ibdata.errors import ConfigError, UsageError
from ibdata.evaluation.play import EvaluationBlock
from ibdata.experiment import Experiment
from ibdata.numerics.exact import exponential, normal
from ibdata.numerics.random import Purpose, integers, stream_key, uniform
from ibdata.policies.checked import PolicyError

FEW_STEPS = {"burn_in": [1, 2]}
NUDGE = {"kind": "constant", "action": [0.5, -1, 0.25]}
# The forms whose SHA-256 the addresses begin with; like the cells' they must never change.
ENVIRONMENT = (
    '{"dynamics": "siemens", "label": "evaluate", "setpoint": "0x1.1800000000000p+6", "start": "default"}'
)
POLICY = (
    '{"dynamics": "siemens", "label": "evaluate", "policy": {"kind": "random"}, '
    '"setpoint": "0x1.1800000000000p+6", "start": "default"}'
)
ADDRESSES = {
    ENVIRONMENT: "de83d400",
    POLICY: "ad3c2f08",
}


class Predicting:
    """A learned policy as SB3 and d3rlpy have them."""

    def __init__(self, answer):
        self.answer, self.seen = answer, []

    def predict(self, observation):
        self.seen.append(observation)
        return self.answer(observation)


def returns(policy, setpoint=70.0, **settings):
    return evaluate(policy, setpoint, **{"steps": 30, "episodes": 4, **settings}).returns[0]


def raw_at(form, seed, index, purpose, steps, slots):
    key = stream_key(seed, hashlib.sha256(form.encode()).digest())
    return integers(key[None], np.array([index]), purpose, 0, steps, slots)[:, :, 0]


def random_action(u):
    return (2.0 * uniform(u[0]) - 1.0, 2.0 * uniform(u[1]) - 1.0, 2.0 * uniform(u[2]) - 1.0)


def replayed(seed, index, steps, discount, actions):
    """The return of an episode at setpoint 70, by `step` and noise from the documented addresses."""
    raw = raw_at(ENVIRONMENT, seed, index, Purpose.DYNAMICS, steps + 1, 8)
    state, total = initial_state(np.array([70.0])), 0.0
    for t in range(steps + 1):
        u = [uniform(x) for x in raw[t]]
        values = [exponential(u[0]), exponential(u[1]), *u[2:6], normal(u[6]), normal(u[7])]
        blank = [np.zeros(1)] * (len(Noise._fields) - 8)
        noise = Noise(*(np.array([x]) for x in values), *blank)
        act = np.array([actions[t - 1] if t else (0.0, 0.0, 0.0)], dtype=np.float32)
        state = step(state, act, noise, VARIANTS["siemens"])
        if t:
            total += discount ** (t - 1) * float(state.reward[0])
    return total


@pytest.mark.parametrize("discount", [1.0, 0.97, 0.0])
def test_the_return_is_the_discounted_sum_of_the_rewards_after_the_zero_action_step(discount):
    found = returns(NUDGE, discount=discount, seed=3)[0]
    expected = [replayed(3, index, 30, discount, [NUDGE["action"]] * 30) for index in range(4)]
    assert found == pytest.approx(expected, rel=1e-13)


def test_a_policys_own_draws_come_from_the_address_with_its_form():
    draws = [raw_at(POLICY, 3, index, Purpose.POLICY, 30, 4) for index in range(4)]
    expected = [replayed(3, index, 30, 0.97, list(map(random_action, draws[index]))) for index in range(4)]
    assert returns("random", discount=0.97, seed=3)[0] == pytest.approx(expected, rel=1e-13)


def test_the_random_numbers_have_their_addresses_for_ever():
    [cell] = Experiment(name="x", setpoints=70, policies=[{"kind": "random"}]).cells
    assert tuple(d.hex()[:8] for d in EvaluationBlock._digests(cell)) == tuple(ADDRESSES.values())
    assert {form: hashlib.sha256(form.encode()).hexdigest()[:8] for form in ADDRESSES} == ADDRESSES


@pytest.mark.parametrize("start", ["default", "uniform", {"burn_in": [2, 9]}], ids=str)
def test_all_policies_meet_the_same_environment(start):
    """A base that always acts is the base, although its wrapper draws from an address of its own."""
    always = {"kind": "epsilon_greedy", "base": NUDGE, "epsilon": 0.0}
    found = evaluate([NUDGE, always, {"kind": "bad"}], start=start, steps=30, episodes=4)
    np.testing.assert_array_equal(found.returns[0], found.returns[1])
    assert (found.returns[0] != found.returns[2]).all()


def test_a_policy_of_ones_own_meets_it_too():
    np.testing.assert_array_equal(returns(Watching()), returns("constant"))


def test_an_evaluation_shares_no_random_number_with_a_dataset(tmp_path):
    """The same cells, with random actions and with none."""
    for policy in ("random", "constant"):
        experiment = Experiment(name="x", setpoints=70, policies=[{"kind": policy}], episodes=4, steps=30)
        made = generate(experiment, tmp_path / policy, workers=1).episodes["return"].to_numpy()
        assert not np.isclose(made, returns(policy, discount=1.0)[0]).any()


def test_nothing_but_the_address_matters():
    """More episodes, steps, setpoints, policies, and more lanes than a block holds."""
    few = returns("random", [10.0, 70.0])
    np.testing.assert_array_equal(returns("random", [70.0])[0], few[1])
    np.testing.assert_array_equal(returns("random", [70.0], episodes=300)[0, :4], few[1])
    np.testing.assert_array_equal(
        evaluate(["safe", "random"], 10.0, steps=30, episodes=4).returns[1], few[:1]
    )
    assert (returns("random", seed=1) != few[1]).all()


def test_steps_beyond_a_chunk_go_on(monkeypatch):
    whole = returns("optimized")
    monkeypatch.setattr("ibdata.evaluation.play.CHUNK", 7)
    np.testing.assert_array_equal(returns("optimized"), whole)


def test_a_policy_sees_its_history_newest_first_and_its_rewards_are_those_of_the_next_observation():
    watching = Watching(frames=3)
    found = returns(watching, discount=0.9)[0]
    seen = np.array(watching.seen)
    assert seen.shape == (30, 4, 3, 6)
    np.testing.assert_array_equal(seen[2:, :, 2], seen[:-2, :, 0])
    np.testing.assert_array_equal(seen[0, :, 1:], np.repeat(seen[0, :, :1], 2, axis=1))
    longer = Watching()
    returns(longer, steps=31)
    after = np.array(longer.seen)[1:, :, 0].astype(np.float64)
    rewards = -after[:, :, 5] - 3.0 * after[:, :, 4]
    assert found == pytest.approx((0.9 ** np.arange(30.0)) @ rewards, rel=1e-6)


def test_predict_gets_flat_histories_and_may_return_a_state():
    model = Predicting(lambda observation: (np.zeros((len(observation), 3)), None))
    np.testing.assert_array_equal(returns(model, history=2), returns("constant"))
    assert {x.shape for x in model.seen} == {(4, 12)}
    np.testing.assert_array_equal(model.seen[-1][:, 6:], model.seen[-2][:, :6])
    np.testing.assert_array_equal(returns(Predicting(lambda x: np.zeros((len(x), 3)))), returns("constant"))


def test_an_answer_that_is_no_action_names_the_policy_and_the_step():
    with pytest.raises(PolicyError) as caught:
        returns(Predicting(lambda observation: observation[:, :2]))
    assert str(caught.value) == (
        "policy predicting: episode 0: step 0: it was given (4, 6), history=1; it returned (4, 2); "
        "expected (4, 3)"
    )


@pytest.mark.parametrize("episodes", [10**11, 2**47, 10**400])
def test_more_episodes_than_memory_holds_are_refused(episodes):
    with pytest.raises(UsageError, match=r"^episodes: this number takes .* GB of memory, but"):
        evaluate("safe", episodes=episodes)


def test_numbers_of_numpy_are_numbers():
    found = evaluate("safe", np.float32(70), steps=np.int64(3), episodes=np.int32(2), seed=np.uint64(4))
    assert (found.returns == evaluate("safe", 70, steps=3, episodes=2, seed=4).returns).all()


def test_a_model_of_which_no_environment_is_known_is_played_as_it_is():
    class Wrapped(Predicting):
        def get_vec_normalize_env(self):
            return None

    wrapped, plain = (kind(lambda seen: seen[:, 1:4] / 200.0) for kind in (Wrapped, Predicting))
    assert (returns(wrapped) == returns(plain)).all()


def test_the_statistics_are_those_of_the_returns():
    found = evaluate("random", [10.0, 70.0], steps=30, episodes=50)
    low, high, overall = found.results
    for result, values in ((low, found.returns[0, 0]), (high, found.returns[0, 1])):
        error = values.std(ddof=1) / np.sqrt(50)
        assert result.mean_return == pytest.approx(values.mean(), rel=1e-14)
        assert result.standard_error == pytest.approx(error, rel=1e-12)
        # Student's t with 49 degrees of freedom: 2.009575
        half = 2.009575 * error
        assert result.interval == pytest.approx((values.mean() - half, values.mean() + half), rel=1e-6)
        assert result.p10 == np.quantile(values, 0.1)
    assert (low.setpoint, high.setpoint, overall.setpoint) == (10.0, 70.0, None)
    assert overall.mean_return == pytest.approx((low.mean_return + high.mean_return) / 2.0)
    assert overall.standard_error == pytest.approx(np.hypot(low.standard_error, high.standard_error) / 2.0)
    assert overall.p10 == np.quantile(found.returns, 0.1)
    assert (low.episodes, overall.episodes) == (50, 100)
    assert low.mean_reward == pytest.approx(returns("random", 10.0, episodes=50, discount=1.0).mean() / 30)


def test_differences_are_paired_and_of_every_two_policies():
    found = evaluate(["safe", "mediocre", "bad"], [10.0, 70.0], steps=30, episodes=20)
    assert [(d.policy, d.less, d.setpoint) for d in found.differences] == [
        (policy, less, p)
        for policy, less in (("mediocre", "safe"), ("bad", "safe"), ("bad", "mediocre"))
        for p in (10.0, 70.0, None)
    ]
    by_hand = found.returns[2, 1] - found.returns[0, 1]
    difference = found.differences[4]
    assert difference.mean_difference == pytest.approx(by_hand.mean())
    assert difference.standard_error == pytest.approx(by_hand.std(ddof=1) / np.sqrt(20))


def test_one_episode_has_no_standard_error():
    [result] = evaluate("random", steps=5, episodes=1).results
    assert result.standard_error is result.interval is None


def test_the_score_is_that_of_the_scale_where_there_is_one():
    found = evaluate(["optimized", "mediocre"], [70.0, 50.0])
    assert [r.score for r in found.results[:3]] == pytest.approx([100.0] * 3, abs=2.0)
    assert all(r.score < 0.0 for r in found.results[3:])
    assert found.results[2].score == (found.results[0].score + found.results[1].score) / 2.0
    assert found.scale.startswith("0 = random, 100 = optimized, or expert for the expert score, at the same")
    for other in ({"steps": 99}, {"discount": 1.0}, {"start": FEW_STEPS}, {"dynamics": {"base": "paper"}}):
        unscaled = evaluate("optimized", **{"episodes": 2, **other})
        assert (unscaled.scale, unscaled.results[0].score) == (None, None)
    assert [r.score for r in evaluate("optimized", [70.0, 71.0], episodes=2).results][1:] == [None, None]


@pytest.mark.parametrize("start", ["uniform", {"burn_in": [15, 64]}], ids=str)
def test_the_score_is_that_of_the_start(start):
    found, known = evaluate("optimized", 75.0, start=start), scale("siemens", start, 100, 0.97)
    assert found.results[0].score == known.score(75.0, found.results[0].mean_return)
    assert found.scale == known.text


def test_the_error_of_a_score_is_that_of_its_return_on_the_scale():
    low, high, overall = evaluate("safe", [10.0, 70.0], episodes=10).results
    for r in (low, high):
        [other] = evaluate("optimized", r.setpoint, episodes=2).results
        slope = (other.score - r.score) / (other.mean_return - r.mean_return)
        assert r.score_error == pytest.approx(slope * r.standard_error)
    assert overall.score_error == pytest.approx(np.hypot(low.score_error, high.score_error) / 2.0)


@pytest.mark.parametrize(
    ("arguments", "notes"),
    [
        ({}, []),
        ({"episodes": 1}, ["no standard error: one episode per policy and setpoint has none"]),
        ({"setpoint": "drifting"}, ["no score: drifting setpoints have none"]),
        (
            {"steps": 7},
            [
                "no score: there are reference returns only for the dynamics siemens, paper; the starts "
                "default, uniform, {burn_in: [15, 64]}; 100 steps with discount 0.97, 1000 steps with "
                "discount 1"
            ],
        ),
        (
            {"setpoint": [71, 70]},
            [
                "no score at setpoint 71, and so none over all setpoints: there are reference returns at "
                "0, 5, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60, 65, 70, 75, 80, 85, 90, 95, 100"
            ],
        ),
    ],
)
def test_what_is_missing_has_a_reason(arguments, notes):
    found = evaluate("constant", **{"episodes": 2, **arguments})
    assert found.notes == notes
    missing = any(None in (r.score, r.score_error, r.standard_error) for r in found.results)
    assert missing == bool(notes)


def test_steps_and_discount_are_told():
    found = evaluate("constant", steps=3, episodes=2, discount=0.5)
    assert (found.steps, found.discount, found.results[0].episodes) == (3, 0.5, 2)


def test_clipped_actions_are_counted_by_policy_and_setpoint():
    def rising(seen):  # beyond 1 at the setpoint 70 only, for every second episode
        return np.where((seen[:, :1] > 50) & (np.arange(len(seen))[:, None] % 2 == 0), 1.5, 1.0) * np.ones(3)

    found = evaluate({"rising": rising, "still": "constant"}, [10.0, 70.0], steps=3, episodes=4)
    assert [r.clipped for r in found.results] == [0.0, 0.5, 0.25, 0.0, 0.0, 0.0]


def test_plain_is_json():
    plain = evaluate(["random", "safe"], episodes=3, steps=5).plain()
    assert json.loads(json.dumps(plain))["results"][1]["policy"] == "safe"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"setpoint": 101}, "setpoint: found 101, expected a number of at most 100"),
        ({"setpoint": []}, "setpoint: found [], expected at least 1 item"),
        ({"steps": 0}, "steps: found 0, expected a whole number of at least 1"),
        (
            {"start": "unifrom"},
            "start: found 'unifrom', expected one of default, uniform; did you mean 'uniform'?",
        ),
        (
            {"dynamics": {"base": "paper", "eta_men": 1}},
            "dynamics.eta_men: no such option; did you mean 'eta_mean'?",
        ),
        ({"discount": 1.5}, "discount: found 1.5, expected a number in [0, 1]"),
        ({"discount": float("nan")}, "discount: found NaN, expected a number in [0, 1]"),
        ({"discount": "x"}, "discount: found 'x', expected a number in [0, 1]"),
        ({"discount": np.array([0.5, 0.9])}, "discount: found [0.5, 0.9], expected a number in [0, 1]"),
        ({"history": 0}, "history: found 0, expected a whole number of at least 1"),
        (
            {"history": 2, "policy": ["optimized", {"x": "random"}]},
            "history: found 2, but no object that could see so many observations",
        ),
        (
            {"history": {"safe": 2}, "policy": "safe"},
            "history: found 'safe', expected no label: any other policy",
        ),
        (
            {"history": {"x": 2}, "policy": {"y": len}},
            "history: found 'x', expected one of y: any other policy",
        ),
        (
            {"history": {"y": 0}, "policy": {"y": len}},
            "history: y: found 0, expected a whole number of at least",
        ),
        ({"policy": Watching}, "policy: found the class Watching, expected an object: Watching(…)"),
        ({"policy": {"": "safe"}}, "policy: found the label '', expected a name"),
        ({"policy": {"mine": 3}}, "policy: found 3, expected an object with act"),
        ({"policy": []}, "policy: found no policy, expected at least one"),
        ({"policy": "optimised"}, "did you mean 'optimized'?"),
        (
            {"policy": 3},
            "policy: found 3, expected an object with act(history, u) or predict(observations), a",
        ),
        ({"policy": "{kind: safe"}, "policy:1:1"),
        ({"policy": "kind: rndom"}, "policy: kind: found 'rndom', expected one of bad"),
        ({"policy": {"kind": "gaussian", "scale": 1}}, "policy: base: missing, expected a value"),
        ({"policy": "a: {b: 1}"}, 'policy: found {"a": {"b": 1}}, expected a mapping with \'kind\''),
    ],
    ids=str,
)
def test_what_cannot_be_meant_is_one_line(arguments, message):
    with pytest.raises(UsageError) as caught:
        evaluate(**{"policy": "random", "episodes": 2, **arguments})
    assert message in str(caught.value)


def test_a_policy_may_stand_in_a_file(tmp_path):
    file = tmp_path / "policy.yaml"
    file.write_text("kind: constant\naction: [0.5, -1, 0.25]\n")
    np.testing.assert_array_equal(returns(file), returns(NUDGE))
    file.write_text("kind: constant\nactoin: 1\n")
    with pytest.raises(ConfigError, match=r"policy.yaml: actoin: no such option; did you mean 'action'\?"):
        returns(file)


def test_labels_are_the_names_and_later_equal_ones_are_numbered():
    found = evaluate(["safe", {"kind": "safe"}, {"kind": "safe", "name": "calm"}], episodes=2, steps=2)
    assert [r.policy for r in found.results] == ["safe", "safe-2", "calm"]


class Seeing:
    """Does nothing, but only with as many observations as it wants."""

    def __init__(self, frames):
        self.frames = frames

    def predict(self, observations):
        assert observations.shape[1] == 6 * self.frames
        return np.zeros((len(observations), 3))


def test_policies_may_have_labels_and_lengths_of_history_of_their_own():
    own = Seeing(4)
    own.history_length = 4
    given = [
        {"TD3 + BC": Seeing(1), "long": Seeing(3), "own": own},
        "constant",
        {"constant": {"kind": "bad"}},
    ]
    found = evaluate(given, history={"long": 3}, steps=3, episodes=2)
    assert [r.policy for r in found.results] == ["TD3 + BC", "long", "own", "constant", "constant-2"]
    assert (found.returns[:3] == found.returns[3]).all()
    assert (
        evaluate([Seeing(3), "constant"], history=3, steps=3, episodes=2).returns == found.returns[3]
    ).all()


def test_a_label_changes_no_random_number():
    random = {"kind": "random"}
    assert returns({"Fred": random}).tolist() == returns(random).tolist()


def test_functions_are_policies():
    def nudge(observations):
        return np.tile(np.float32(NUDGE["action"]), (len(observations), 1))

    found = evaluate([nudge, lambda seen: (nudge(seen), None), NUDGE], steps=30, episodes=4)
    assert [r.policy for r in found.results] == ["nudge", "lambda", "constant"]
    assert (found.returns == found.returns[2]).all()


def test_a_moving_setpoint_begins_where_it_says_and_has_no_score():
    one, two = (evaluate("safe", p, episodes=20) for p in ("drifting", {"drifting": [50, 80]}))
    assert [result.setpoint for result in two.results] == [50.0, 80.0, None]
    assert one.results[0] == two.results[0]
    assert evaluate("safe", 50, episodes=20).results[0].mean_return != one.results[0].mean_return
    assert {result.score for result in (*one.results, *two.results)} == {None}
    assert (one.scale, two.scale) == (None, None)
