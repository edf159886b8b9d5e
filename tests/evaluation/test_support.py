"""Which data can evaluate which policy, and that the mean weights of these pairs are 1."""

from __future__ import annotations

import re
from collections import defaultdict
from itertools import product

import numpy as np
import pytest
from helpers import ROOT
from helpers.evaluating import BAD, NETWORK, POLICY, Data, few, policy_of, supported
from helpers.refusals import refused

import ibdata
from ibdata.errors import UsageError
from ibdata.evaluation.importance import notes_on_mean_weights, without_large
from ibdata.evaluation.overlap import Ratios
from ibdata.policies import Certain, Decision, Needs

CORE = ("random", "safe", "bad", "sampled", "ε-greedy", "sticky bad", "schedule")


def test_the_mean_weights_are_1_or_a_message_says_why_not():
    """Without large weights and with what they would add, so for heavy tails too."""
    pairs = [pair for pair in product(CORE, CORE) if supported(few(pair[0]), POLICY[pair[1]])]
    assert {(name, name) for name in CORE} < set(pairs)
    for name, target in pairs:
        weights = sum(without_large(few(name).ratios(POLICY[target])))
        assert far_from_1(weights) < 4.0, (name, target)


def far_from_1(weights):
    """How many standard errors the mean weights of all steps are from 1."""
    error = np.maximum(weights.std(axis=0, ddof=1) / np.sqrt(len(weights)), 1e-6)  # densities are float32
    return (np.abs(weights.mean(axis=0) - 1.0) / error).max()


@pytest.mark.parametrize(
    ("name", "target", "said"),
    [
        ("unknown", "unknown", "policy lambda: found no log density"),
        ("gaussian", "ornstein_uhlenbeck", "ornstein_uhlenbeck, which has a memory and random numbers"),
    ],
)
def test_densities_that_nobody_knows_are_refused(name, target, said):
    refused(said, few(name).importance, POLICY[target])


def kinds(base):
    """Policies as the page's table has them."""
    blocks = {
        "random": {"kind": "random"},
        "safe": {"kind": "safe"},
        "base": base,
        "ε-greedy": {"kind": "epsilon_greedy", "base": base, "epsilon": 0.5},
        "gaussian": {"kind": "gaussian", "base": base, "scale": 1.0},
        "sticky": {"kind": "sticky", "base": base, "kappa": 0.5},
    }
    return {name: policy_of(block) for name, block in blocks.items()}


def test_the_page_says_which_pairs_have_support():
    """A cell is `wide` if noise of scale 1 has support and noise of scale 0.3 has not."""
    answers = defaultdict(set)
    for base in (BAD, {"kind": "expert"}, NETWORK):
        targets = kinds(base)
        narrow = policy_of({"kind": "gaussian", "base": base, "scale": 0.3})
        for name, behaviour in {**targets, "narrow": narrow}.items():
            data = Data(behaviour, 300)
            for target, policy in targets.items():
                answers[name, target].add(supported(data, policy))
    assert {len(found) for found in answers.values()} == {1}  # whatever the base
    names = list(targets)
    shown = ["| data of \\ target | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for name in names:
        cells = ["yes" if answers[name, target] == {True} else "–" for target in names]
        if name == "gaussian":
            cells = [
                "wide" if cell == "yes" and answers["narrow", target] == {False} else cell
                for cell, target in zip(cells, names, strict=True)
            ]
        shown.append(f"| {name} | " + " | ".join(cells) + " |")
    page = (ROOT / "docs/off-policy.md").read_text(encoding="utf-8")
    assert "\n".join(shown) in page


@pytest.mark.parametrize(
    ("name", "target"), [("random", "safe"), ("bad", "random"), ("mixture", "safe"), ("schedule", "gaussian")]
)
def test_actions_that_the_data_never_have_are_named(name, target):
    """Those of a mixture in an episode of random."""
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


@pytest.mark.parametrize("wrong", [-0.1, 0.1])
def test_a_wrong_density_is_a_warning(wrong):
    """Of normal actions, where the target's mean is 0.2 standard deviations away."""
    random = np.random.default_rng(0)
    logs = (0.2 * (random.normal(size=(4000, 30)) + 0.2 * action) - 0.02 + wrong for action in (0, 1))
    ratios = Ratios(*logs)
    [note] = notes_on_mean_weights(ratios, np.exp(np.cumsum(ratios.recorded, axis=1)))
    found = re.fullmatch(
        r"warning: the mean weight of step (\d+) is (\d\.\d+) ± 0\.\d+, further from 1 than chance allows: "
        "one of the densities is wrong",
        note,
    )
    assert int(found[1]) <= 3
    assert (float(found[2]) - 1.0) * wrong > 0.0


HALF_UP = {"kind": "constant", "action": [0.5, 0.5, 0.5]}


class Counting:
    """Acts as a constant policy does in the first steps only, which it counts itself."""

    def reset(self, n):
        self.step = 0

    def decide(self, observed):
        self.step += 1
        size = 0.0 if self.step <= 3 else 0.5
        return Decision(Certain(np.full((len(observed.step), 3), size)), observed.memory)


def test_an_object_that_remembers_is_asked_step_by_step(tmp_path):
    base = {"kind": "schedule", "stages": [{"base": "constant", "steps": 3}, {"base": HALF_UP}]}
    data = {"name": "x", "setpoints": [20, 70], "episodes": 300, "steps": 5}
    mixed = {"kind": "schedule", "stages": [{"base": "constant", "epsilon": [0.5, 0.5], "steps": 3}]}
    mixed["stages"].append({"base": HALF_UP, "epsilon": [0.5, 0.5], "steps": 9})
    ds = ibdata.generate({**data, "policies": [mixed]}, tmp_path / "x")
    expected, found = (ibdata.importance(ds, target) for target in (base, Counting()))
    np.testing.assert_array_equal(found.ratios, expected.ratios)
    assert 0.0 < (found.ratios > 0.0).mean() < 1.0
    drawing = type("Drawing", (Counting,), {"needs": Needs(draws=3)})()
    refused("found live, which has a memory and random numbers", ibdata.importance, ds, drawing)
