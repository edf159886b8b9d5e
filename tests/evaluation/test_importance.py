"""Importance weights: which pairs of policies have support, and that the weights are right."""

from __future__ import annotations

import re
from itertools import product

import numpy as np
import pytest
from helpers.evaluating import POLICY
from helpers.refusals import refused

import ibdata
from ibdata.errors import PolicyError, UsageError
from ibdata.evaluation.importance import of_ratios
from ibdata.evaluation.overlap import Ratios, log_ratios
from ibdata.experiment import Experiment
from ibdata.policies import POLICIES, Certain, ClippedNormal, Decision, Distribution, Needs


def of_logs(logs, rewards, discount):
    """The estimates where every action that the target draws has the ratio 1."""
    return of_ratios("x", Ratios(logs, np.zeros_like(logs)), rewards, discount)


def test_the_estimates_are_those_of_the_equations():
    ratios, rewards = np.array([[2.0, 0.5], [1.0, 3.0]]), np.array([[-1.0, -2.0], [-4.0, -8.0]])
    found = of_logs(np.log(ratios), rewards, 0.5)
    weighted, per_decision, ordinary = found.results
    assert ordinary.mean_return == pytest.approx((1.0 * -2.0 + 3.0 * -8.0) / 2)
    assert per_decision.mean_return == pytest.approx((2.0 * -1.0 + 1.0 * -1.0 + 1.0 * -4.0 + 3.0 * -4.0) / 2)
    assert weighted.mean_return == pytest.approx((2.0 * -1.0 + 1.0 * -4.0) / 3 + (-1.0 + 3.0 * -4.0) / 4)
    assert found.weights == pytest.approx(np.array([[2.0, 1.0], [1.0, 3.0]]))
    assert found.effective == pytest.approx([9 / 5, 16 / 10])
    assert ordinary.interval[0] < ordinary.mean_return < ordinary.interval[1]
    (note,) = found.notes
    assert note.startswith("warning: weighted rests on 1.6 effective episodes, fewer than 100")
    assert note in repr(found)
    assert "mean_weight" in repr(found)
    for plain in found.plain()["results"]:
        assert (plain["mean_weight"], plain["weight_error"]) == pytest.approx((2.0, 1.0))
        assert plain["effective"] == pytest.approx(1.6)
    assert list(found.to_pandas()["method"]) == ["weighted", "per decision", "ordinary"]


def test_steps_from_which_all_weights_are_0_are_named():
    ratios = np.array([[0.0, -np.inf, 0.0, 0.0], [0.0, 0.0, -np.inf, 0.0]])
    found = of_logs(ratios, np.ones((2, 4)), 1.0)
    assert found.effective.tolist() == [2.0, 1.0, 0.0, 0.0]
    assert "are 0 from step 2 on, so there is no weighted estimate" in found.notes[0]
    assert [each.mean_return for each in found.results] == [None, 1.5, 0.0]


def test_weights_that_overflow_have_no_estimate():
    ratios = Ratios(np.zeros((3, 50)), np.zeros((3, 50)))
    ratios.recorded[0] = 20.0
    found = of_ratios("x", ratios, np.ones((3, 50)), 1.0)
    assert [r.mean_return for r in found.results] == [pytest.approx(50.0), None, None]
    assert found.notes[0].startswith(
        "warning: some weights are larger than any number, so only the weighted "
    )


def test_errors_equal_the_jackknife():
    """To the last digits for means; of the weighted estimate, a ratio, to the order 1/n."""
    episodes, rng = 300, np.random.default_rng(1)
    log_ratios = rng.normal(-0.02, 0.2, (episodes, 4))
    rewards = 5.0 + 10.0 * log_ratios + rng.normal(0.0, 1.0, log_ratios.shape)
    every = np.arange(episodes)
    without = [of_logs(log_ratios[every != i], rewards[every != i], 0.9).results for i in every]
    for i, found in enumerate(of_logs(log_ratios, rewards, 0.9).results):
        values = np.array([each[i].mean_return for each in without])
        error = np.sqrt((episodes - 1) / episodes * ((values - values.mean()) ** 2).sum())
        near = 4.0 / episodes if found.method == "weighted" else 1e-6
        assert found.standard_error == pytest.approx(error, rel=near), found.method


def warned_of(found):
    """The methods whose estimates have a warning of their own."""
    said = "\n".join(found.notes)
    return [each.method for each in found.results if re.search(f"(: |; ){each.method} ", said)]


def test_estimates_far_off_have_a_warning_and_near_ones_none():
    """Of normal actions, with the target's mean 1 or 3 standard deviations away."""
    warned = {True: [], False: []}
    for seed, shift in product(range(60), (1.0, 3.0)):
        rng = np.random.default_rng(seed)
        recorded, drawn = rng.normal(size=(500, 1)), rng.normal(shift, size=(500, 1))
        ratios = Ratios(*(shift * action - shift**2 / 2.0 for action in (recorded, drawn)))
        found = of_ratios("x", ratios, -100.0 + 3.0 * recorded + rng.normal(0.0, 10.0, (500, 1)), 1.0)
        for each in found.results[1:]:
            off = abs(each.mean_return - (-100.0 + 3.0 * shift)) / each.standard_error
            if not 2.0 < off <= 4.0:
                warned[off > 4.0].append(each.method in warned_of(found))
    assert np.mean(warned[True]) >= 0.95
    assert np.mean(warned[False]) <= 0.05
    assert min(len(of) for of in warned.values()) > 20


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Two policies at two setpoints, in three shards, after a burn-in, with a split of scattered episodes."""
    experiment = Experiment(
        name="x", setpoints=[10, 70], episodes=20, steps=6, start={"burn_in": [2, 5]},
        policies=[POLICY["ε-greedy of expert"], POLICY["random"]], output={"shard_rows": 150},
        splits={"some": {"episodes": {"start": 3, "stop": 11}}},
    )  # fmt: skip
    return ibdata.generate(experiment, tmp_path_factory.mktemp("importance") / "x", workers=1)


def test_the_parts_of_a_policy_are_alike_in_size(dataset, monkeypatch, small_blocks):
    """A small rest could be refused for one rare action."""
    whole, sizes = ibdata.importance(dataset, "random"), []

    def counted(part, *others):
        sizes.append(len(part.numbers))
        return log_ratios(part, *others)

    small_blocks(compared_rows=6 * 15)
    monkeypatch.setattr("ibdata.evaluation.importance.log_ratios", counted)
    in_parts = ibdata.importance(dataset, "random")
    assert sizes == [14, 13, 13] * 2
    assert in_parts.ratios == pytest.approx(whole.ratios, rel=1e-12)
    assert in_parts.notes == whole.notes


def test_memory_is_replayed_along_the_recorded_episode(dataset):
    """The expert remembers what it saw, also of the burn-in; where it acted, the ratio is 1/(1 - ε)."""
    found = ibdata.importance(dataset.select(policy="epsilon_greedy"), "expert")
    assert set(np.unique(found.ratios.round(4))) == {0.0, 1.25}
    log_prob = (
        dataset.select(policy="epsilon_greedy").table(["action_log_prob"])["action_log_prob"].to_numpy()
    )
    kept = np.isclose(log_prob, np.log(0.8)).reshape(-1, 6)
    assert (found.ratios > 0.0).tolist() == kept.tolist()
    same = ibdata.importance(dataset.select(policy="epsilon_greedy"), POLICY["ε-greedy of expert"])
    assert same.weights == pytest.approx(np.ones((40, 6)), rel=1e-5)
    refused("by random, the policy of the data", ibdata.importance, dataset, "expert")


class Anywhere(Distribution):
    """Uniform on (-1, 1)³, with a density that does not look where it is asked."""

    draws = 3

    def sample(self, u):
        return 2.0 * u - 1.0

    def log_density(self, action):
        return np.full(len(action), -np.log(8.0))

    def atoms(self, action):
        return np.zeros(action.shape, dtype=bool)


class Inside:
    needs = Needs(draws=3)

    def decide(self, observed):
        return Decision(Anywhere(), observed.memory)


def test_a_density_is_0_at_point_masses_it_lacks(dataset):
    """The formula's clipped actions are at ±1, where the measure has point masses."""
    actions = dataset.table(["act_velocity", "act_gain", "act_shift"]).to_pandas().to_numpy()
    corner = (np.abs(actions) == 1.0).all(axis=1).reshape(80, 6)
    assert 0 < corner.sum() < corner.size
    random, inside = (ibdata.importance(dataset, x) for x in ("random", Inside()))
    assert (inside.ratios[corner] == 0.0).all()
    assert inside.ratios == pytest.approx(random.ratios)


ANSWERS = [
    ("log_density", lambda self, action: np.zeros((len(action), 1)), r"log densities of shape \(\d+, 1\)"),
    ("log_density", lambda self, action: action[:, 5], "test_importance.py:[0-9]+: IndexError"),
    ("atoms", lambda self, action: np.zeros(len(action), bool), r"found atoms of bool and shape \(\d+,\)"),
    ("sample", lambda self, u: u[:, :2], r"found actions of shape \(\d+, 2\)"),
    ("log_density", lambda self, action: ClippedNormal(np.zeros((1, 3)), 0.5).log_density(action),
     r"found means of shape \(1, 3\), expected \(\d+, 3\)"),
]  # fmt: skip


@pytest.mark.parametrize(("method", "answer", "message"), ANSWERS)
def test_what_a_distribution_answers_is_checked(dataset, method, answer, message):
    answering = type("Answering", (Anywhere,), {method: answer})

    class Target(Inside):
        def decide(self, observed):
            return Decision(answering(), observed.memory)

    with pytest.raises(PolicyError, match=f"^policy target: (episode [0-9]+|asked .*): step 0: .*{message}"):
        ibdata.importance(dataset.select(policy="random"), Target())


def test_bad_arguments_are_named(dataset):
    for arguments, said in (
        ({"target": "random", "discount": 1.5}, "discount: found 1.5"),
        ({"target": "random", "steps": 7}, "steps: found 7, expected a whole number from 1 to 6"),
        ({"target": lambda seen: np.zeros((len(seen), 3))}, "policy lambda: found no log density"),
        ({"target": "random", "policy": "safe"}, "policy: no such option"),
        ({"target": "random", "history": 2}, "history: found 2, but no object"),
    ):
        refused(said, ibdata.importance, dataset, **arguments)


def test_episodes_chosen_by_their_returns_are_refused(dataset):
    """The mean of the better half is not the policy's; further conditions do not change that."""
    best = dataset.select(returns=(float(np.median(dataset.episodes["return"])), None))
    for chosen in (best, best.select(policy="random"), best.select(returns=(None, 0.0))):
        refused(r"^returns: found episodes that were chosen by", ibdata.importance, chosen, "random")
    ibdata.importance(dataset.select(episodes=range(40, 80)), "random")
    everything = dataset.select(returns=(None, 0.0))  # limits that exclude nothing choose nothing
    assert ibdata.importance(everything, "random").plain() == ibdata.importance(dataset, "random").plain()


def test_episodes_of_different_lengths_are_refused(dataset, tmp_path):
    plain = {**dataset.manifest["experiments"][0], "steps": 5, "policies": [{"kind": "random"}]}
    other = ibdata.generate(Experiment(**{**plain, "seed": 1}), tmp_path / "other", workers=1)
    both = ibdata.merge([dataset.path, other.path], tmp_path / "both")
    refused("steps: found episodes of 5 and of 6, expected one length", ibdata.importance, both, "random")
    assert ibdata.importance(both, "random", steps=5).weights.shape == (120, 5)


def test_a_subclass_is_not_the_policy_of_the_data(dataset):
    class Other(POLICIES["random"]):
        def decide(self, observed):
            return Decision(Certain(np.zeros((len(observed.step), 3))), observed.memory)

    with pytest.raises(UsageError, match="actions are taken by random, the policy of the data, less than"):
        ibdata.importance(dataset.select(policy="random"), Other())
