"""Policies as users give them to an evaluation, and arguments that are refused."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.evaluating import NUDGE, returns
from helpers.watching import Watching

from ibdata import evaluate
from ibdata.errors import ConfigError, UsageError
from ibdata.policies import Needs

REFUSED = [
    ({"setpoint": 101}, "setpoint: found 101, expected a number of at most 100"),
    ({"start": "unifrom"}, "start: found 'unifrom', expected one of default, uniform; did you mean"),
    ({"dynamics": {"base": "paper", "eta_men": 1}}, "dynamics.eta_men: no such option; did you mean"),
    ({"discount": 1.5}, "discount: found 1.5, expected a number in [0, 1]"),
    ({"discount": np.array([0.5, 0.9])}, "discount: found [0.5, 0.9], expected a number in [0, 1]"),
    ({"history": 0}, "history: found 0, expected a whole number of at least 1"),
    ({"history": 2, "policy": ["optimized"]}, "history: found 2, but no object that could see so many"),
    ({"history": {"safe": 2}, "policy": "safe"}, "history: found 'safe', expected no label: any other"),
    ({"history": {"x": 2}, "policy": {"y": len}}, "history: found 'x', expected one of y: any other policy"),
    ({"history": {"y": 0}, "policy": {"y": len}}, "history: y: found 0, expected a whole number of at least"),
    ({"policy": Watching}, "policy: found the class Watching, expected an object: Watching(…)"),
    ({"policy": {"": "safe"}}, "policy: found the label '', expected a name"),
    ({"policy": {"mine": 3}}, "policy: found 3, expected an object with decide(given), act(history, u) or"),
    ({"policy": []}, "policy: found no policy, expected at least one"),
    ({"policy": "optimised"}, "did you mean 'optimized'?"),
    ({"policy": "{kind: safe"}, "policy:1:1"),
    ({"policy": "kind: rndom"}, "policy: kind: found 'rndom', expected one of bad"),
    ({"policy": {"kind": "gaussian", "scale": 1}}, "policy: base: missing, expected a value"),
    ({"policy": "a: {b: 1}"}, 'policy: found {"a": {"b": 1}}, expected a block such as'),
    ({"episodes": 10**400}, "episodes: this number takes "),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "message"), REFUSED, ids=str)
def test_what_cannot_be_meant_is_one_line(arguments, message):
    with pytest.raises(UsageError) as caught:
        evaluate(**{"policy": "random", "episodes": 2, **arguments})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_policy_may_stand_in_a_file(tmp_path):
    file = tmp_path / "policy.yaml"
    file.write_text("kind: constant\naction: [0.5, -1, 0.25]\n")
    np.testing.assert_array_equal(returns(file), returns(NUDGE))
    file.write_text("kind: constant\nactoin: 1\n")
    with pytest.raises(ConfigError, match=r"policy.yaml: actoin: no such option; did you mean 'action'\?"):
        returns(file)


def test_labels_are_the_names_and_later_equal_ones_are_numbered():
    given = ["random", {"kind": "random"}, {"kind": "random", "name": "calm"}, {"Fred": "random"}]
    found = evaluate(given, episodes=2, steps=2)
    assert [r.policy for r in found.results] == ["random", "random-2", "calm", "Fred"]
    assert (found.returns == found.returns[0]).all()  # labels change no random number


class Seeing:
    """Does nothing, but only with as many observations as it wants."""

    def __init__(self, frames):
        self.frames = frames

    def predict(self, observations):
        assert observations.shape[1] == 6 * self.frames
        return np.zeros((len(observations), 3))


def test_policies_may_have_labels_and_lengths_of_history_of_their_own():
    own = Seeing(4)
    own.needs = Needs(history=4)
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


def test_functions_are_policies():
    def nudge(observations):
        return np.tile(np.float32(NUDGE["action"]), (len(observations), 1))

    found = evaluate([nudge, lambda seen: (nudge(seen), None), NUDGE], steps=30, episodes=4)
    assert [r.policy for r in found.results] == ["nudge", "lambda", "constant"]
    assert (found.returns == found.returns[2]).all()
