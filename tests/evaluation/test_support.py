"""Which data can evaluate which policy, and that the mean weights of these pairs are 1."""

from __future__ import annotations

import re
from itertools import product

import numpy as np
import pytest
from helpers import ROOT
from helpers.weighing import BAD, POLICY, Data, few, policy_of, supported

from ibdata.errors import UsageError
from ibdata.evaluation import overlap
from ibdata.evaluation.mean_weights import notes_on_mean_weights, without_large
from ibdata.evaluation.overlap import Ratios

N = 20_000
CORE = ("random", "safe", "bad", "sampled", "ε-greedy", "sticky bad", "schedule")


def test_the_mean_weights_are_1_or_a_message_says_why_not():
    """Without large weights and with what they would add, so for heavy tails too."""
    pairs = [pair for pair in product(CORE, CORE) if supported(pair[0], POLICY[pair[1]])]
    assert {(name, name) for name in CORE} < set(pairs)
    for name, target in pairs:
        weights = sum(without_large(few(name).ratios(POLICY[target])))
        assert far_from_1(weights) < 4.0, (name, target)


@pytest.mark.slow
@pytest.mark.parametrize("name", POLICY)
def test_the_mean_weights_of_many_episodes_are_1_or_a_message_says_why_not(name):
    targets = [target for target in POLICY.values() if supported(name, target)]
    data = Data(POLICY[name], N) if len(targets) > 1 else few(name)
    for target in targets:
        try:
            found = data.importance(target)
        except UsageError as error:  # of more actions, more are tried
            if "less than once in 60,000 rows" not in str(error):
                raise
            continue
        if found.effective[-1] < 100:
            assert any("fewer than 100" in note for note in found.notes)
        elif found.effective[-1] < 1000 or any("too rare" in note for note in found.notes):  # heavy tails
            assert far_from_1(sum(without_large(data.ratios(target)))) < 4.0, target.label
        else:
            assert far_from_1(found.weights) < 4.0, target.label
            assert found.notes == []


def far_from_1(weights):
    """How many standard errors the mean weights of all steps are from 1."""
    error = np.maximum(weights.std(axis=0, ddof=1) / np.sqrt(len(weights)), 1e-6)  # densities are float32
    return (np.abs(weights.mean(axis=0) - 1.0) / error).max()


def test_data_without_a_known_density_are_refused():
    with pytest.raises(UsageError, match="policy coloured_noise: found no log density"):
        few("coloured_noise").importance(POLICY["coloured_noise"])


# What the page says of pairs, by data and target; a base is always the same one.
TABLE = {
    "random": "random",
    "safe": "safe",
    "base": "bad",
    "ε-greedy": "ε-greedy",
    "gaussian": "gaussian",
    "sticky": "sticky bad",
}


def test_the_page_says_which_pairs_have_support():
    shown = ["| data of \\ target | " + " | ".join(TABLE) + " |", "|---" * (len(TABLE) + 1) + "|"]
    for name, behaviour in TABLE.items():
        cells = ["yes" if supported(behaviour, POLICY[target]) else "–" for target in TABLE.values()]
        shown.append(f"| {name} | " + " | ".join(cells) + " |")
    page = (ROOT / "docs/off-policy-evaluation.md").read_text(encoding="utf-8")
    assert "\n".join(shown) in page


@pytest.mark.parametrize(
    ("name", "target"),
    [
        ("random", "safe"),
        ("safe", "gaussian"),
        ("random", "bad"),
        ("bad", "random"),
        ("mixture", "safe"),  # in an episode of random
        ("schedule", "gaussian"),
    ],
)
def test_actions_that_the_data_never_have_are_named(name, target):
    with pytest.raises(UsageError) as error:
        few(name).importance(POLICY[target])
    found = re.fullmatch(
        r"policy (.+): found that (.+)% of its actions are taken by (.+), the policy of the data, less "
        r"than once in 3,000 rows, such as \[.*\] at step (\d); expected data of a policy that can take "
        r"every action of \1",
        str(error.value),
    )
    assert found is not None
    assert (found[1], found[3]) == (POLICY[target].label, POLICY[name].label)
    assert 0.0 < float(found[2]) <= 100.0


def test_a_target_that_remembers_random_numbers_is_refused():
    with pytest.raises(UsageError, match="ornstein_uhlenbeck, which remembers its random numbers"):
        few("gaussian").importance(POLICY["ornstein_uhlenbeck"])


def test_support_changes_with_the_step():
    """At the first step of a schedule every action is random, and at the first of sticky none is repeated."""
    begin = policy_of({"kind": "schedule", "stages": [{"base": BAD, "steps": 3, "epsilon": [1.0, 0.5]}]})
    assert supported("schedule", begin)
    with pytest.raises(UsageError, match="at step 0; expected"):
        Data(begin, 50).importance(POLICY["schedule"])
    stages = [{"base": POLICY["ε-greedy"].model_dump(), "steps": 2}, {"base": {"kind": "random"}}]
    with pytest.raises(UsageError, match="at step 2; expected"):
        Data(policy_of({"kind": "schedule", "stages": stages}), 50).importance(POLICY["ε-greedy"])


# A draw of these networks is ±1 with a probability down to 1e-20, and the target's action is often.
SATURATED = [("p70-3", 0.6), ("neorl-medium", 0.1)]


@pytest.mark.parametrize(("file", "scale"), SATURATED)
def test_point_masses_that_the_data_hardly_ever_have_are_no_support(file, scale):
    base = {"kind": "network", "file": file}
    data = Data(policy_of({"kind": "sampled", "base": base, "share": 1.0}))
    said = r"found that \d\d\.\d\d% of its actions are taken by sampled, the policy of the data, less than"
    with pytest.raises(UsageError, match=said):
        data.importance(policy_of({"kind": "gaussian", "base": base, "scale": scale}))


def test_a_mean_weight_of_rare_actions_is_a_warning(monkeypatch):
    """If the same pair were accepted."""
    monkeypatch.setattr(overlap, "_refuse_lack", lambda *_: None)
    found = Data(POLICY["sampled"], 2000).importance(POLICY["gaussian of network"])
    mean, share = re.search(
        r"warning: the mean weight of step 0 is (0\.\d+) ± 0\.\d+, expected 1: (\d+)% of", found.notes[-1]
    ).groups()
    assert float(mean) == pytest.approx(found.weights[:, 0].mean(), abs=1e-3)
    assert float(mean) + 0.01 * float(share) == pytest.approx(1.0, abs=0.05)


# Log ratios of correct pairs of policies, by the number of a behaviour's action (0) or of a target's (1).
def shifted(random, shape, action):
    """Normal actions; the target's mean is 0.2 standard deviations away."""
    return 0.2 * (random.normal(size=shape) + 0.2 * action) - 0.02


def rare(random, shape, action):
    """An action with the probability 0.01, or the target's 0.1."""
    return np.log(np.where(random.random(shape) < (0.01, 0.1)[action], 0.1 / 0.01, 0.9 / 0.99))


def notes_of(law, shape, seed, wrong=0.0):
    random = np.random.default_rng(seed)
    ratios = Ratios(*(law(random, shape, action) + wrong for action in (0, 1)))
    with np.errstate(over="ignore"):
        return notes_on_mean_weights(ratios, np.exp(np.cumsum(ratios.recorded, axis=1)))


def near(random, shape, action):
    """Normal actions; the target's mean is 0.03 standard deviations away, as in long episodes."""
    return 0.03 * (random.normal(size=shape) + 0.03 * action) - 0.00045


LAWS = (shifted, rare)
SHAPES = ((100, 1), (100, 30), (400, 5), (400, 30), (2000, 5), (2000, 30))


@pytest.mark.slow
def test_chance_gives_a_false_alarm_once_in_a_thousand_calls():
    """Of 1,200 calls for correct pairs; that of the weights themselves would alarm in more than 2 %."""
    notes = [notes_of(law, shape, seed) for law in LAWS for shape in SHAPES for seed in range(100)]
    assert not sum("chance" in note for seed in range(200) for note in notes_of(near, (100, 1000), seed))
    assert sum("chance" in note for found in notes for note in found) <= 1
    assert sum("too rare" in note for found in notes for note in found) > 24


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("wrong", [-0.1, 0.1])
def test_a_wrong_density_is_a_warning(law, wrong):
    [note] = notes_of(law, (4000, 30), 0, wrong)
    found = re.fullmatch(
        r"warning: the mean weight of step (\d+) is (\d\.\d+) ± 0\.\d+, further from 1 than chance allows: "
        "one of the densities is wrong",
        note,
    )
    assert int(found[1]) <= 3
    assert (float(found[2]) - 1.0) * wrong > 0.0
