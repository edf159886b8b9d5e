"""Policies made of objects: in which way they are asked, with which arrays, and what they may answer."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import pytest
from helpers.objects import Mine, Still, Sure, still
from helpers.policies import proposed, ready
from helpers.refusals import refused
from pydantic import Field

import ibdata
from ibdata.errors import ConfigError, PolicyError
from ibdata.evaluation.policies import as_policy
from ibdata.policies import AnyPolicy, ClippedNormal, Decision, Needs, Policy
from ibdata.policies.checked import AnswerError

HISTORY = np.arange(60, dtype=np.float32).reshape(5, 2, 6)
NOTHING = np.empty((5, 0))
GIVEN = "it was given observations (5, 12)"


def asked(target, history=2):
    return proposed(ready(as_policy(target, history)), HISTORY[:, :history], NOTHING)


class Greedy:
    """Changes what it is given, as it would its own arrays."""

    def act(self, history, u):
        history *= 2.0
        u += 1.0
        return history[:, 0, 1:4]


class Deciding:
    def decide(self, given):
        given.observations[:] *= 2.0
        return Decision(given.observations[:, 0, 1:4], given.memory)


class Predicting:
    def predict(self, observations):
        observations *= 2.0
        return observations[:, 1:4], "state"


def doubled(observations):
    observations *= 2.0
    return observations[:, 1:4]


@pytest.mark.parametrize(
    "target", [Greedy(), Deciding(), Predicting(), doubled], ids=lambda target: type(target).__name__
)
def test_what_is_given_may_be_changed_and_is_a_copy(target):
    history = HISTORY.copy()
    history.flags.writeable = False
    policy = ready(as_policy(target, 2))
    np.testing.assert_array_equal(proposed(policy, history, NOTHING), 2.0 * HISTORY[:, 0, 1:4])
    np.testing.assert_array_equal(history, HISTORY)


@pytest.mark.parametrize(
    ("answer", "line"),
    [
        (lambda seen: seen[:, :2], "found actions of shape (5, 2), expected actions of shape (5, 3)"),
        (lambda seen: "up", "found 'up', expected actions of shape (5, 3)"),
        (lambda seen: (1, 2, 3), "found a tuple of 3, expected actions, or actions and a state"),
        (lambda seen: seen[9], "IndexError: index 9 is out of bounds for axis 0 with size 5"),
    ],
)
def test_what_is_no_action_says_what_was_given(answer, line):
    with pytest.raises(AnswerError) as error:
        asked(answer)
    place = f"test_user_object.py:{answer.__code__.co_firstlineno}: " if "IndexError" in line else ""
    assert str(error.value).endswith(f"{place}{line}; {GIVEN}")


def test_a_density_of_another_form_is_refused_with_a_hint():
    for method in ("log_prob", "log_density"):
        other = type("Other", (Predicting,), {method: lambda self, *_: None})()
        line = f"Other: found {method}, expected decide to return Decision\\("
        for given in (
            other,
            {"kind": "custom", "target": other},
            {"kind": "schedule", "stages": [{"base": other}]},
        ):
            refused(line, as_policy, given)


def test_a_policy_of_a_user_keeps_its_name_in_an_experiment():
    """As it does where it is evaluated; a name beside it comes first, and a base has none."""
    blocks = [Still(name="one"), {"kind": "custom", "target": Still(name="one"), "name": "two"}, Still()]
    made = ibdata.Experiment(name="x", setpoints=70, policies=blocks)
    for each in (made, ibdata.Experiment(**made.model_dump())):
        assert list(each.labels) == ["one", "two", "still"]
    within = {"kind": "epsilon_greedy", "base": Still(name="one"), "epsilon": 0.1}
    with pytest.raises(ibdata.IbdataError, match="name: found 'one' in a base, expected the name beside"):
        ibdata.Experiment(name="x", setpoints=70, policies=[within])


class Around(Policy):
    """A policy of a user around another one."""

    kind: Literal["around"] = "around"
    base: AnyPolicy

    @property
    def needs(self):
        return self.base.needs

    def decide(self, observed):
        return self.base.decide(observed)


class Counting:
    """Remembers the number of steps."""

    needs = Needs(history=2, memory=1)

    def decide(self, observed):
        assert observed.observations.shape[1] == 2
        return Decision(np.tile(observed.memory / 10.0, 3), observed.memory + 1.0)


def test_a_policy_of_a_user_may_be_around_an_object_or_another():
    """Also within other policies, which ask for its needs before it is loaded."""
    around = Around(base=Around(base=Counting()))
    assert ibdata.Experiment(name="x", setpoints=70, policies=[around]).policies[0].history == 2
    within = {"kind": "epsilon_greedy", "base": around, "epsilon": 0.0}
    found = ibdata.evaluate([Counting(), around, within], steps=5, episodes=2)
    assert (found.returns == found.returns[0]).all()


def test_a_block_around_a_policy_must_give_what_it_needs():
    """Else it would read beyond what it is given."""
    block = {"kind": "custom", "target": Around(base=Counting()), "history": 1}
    line = "^live:Around: found history: 1, expected at least the needs of Around; write history: 2$"
    refused(line, ibdata.evaluate, block, steps=3, episodes=2, error=PolicyError)
    evaluated = ibdata.evaluate([{**block, "history": 3}, Counting()], steps=3, episodes=2)
    assert (evaluated.returns[0] == evaluated.returns[1]).all()


def test_a_deterministic_policy_of_a_user_may_be_the_base_of_noise():
    """Its class is the promise that it draws nothing."""

    class Drawing(Sure):
        needs = Needs(draws=3)

    noisy = {"kind": "gaussian", "base": Sure(), "scale": 0.1}
    assert ibdata.evaluate(noisy, steps=3, episodes=2).returns.size == 2
    for base in (Still(), Drawing()):
        refused("without deterministic: true", as_policy, {**noisy, "base": base}, error=ibdata.IbdataError)


class Noisy(Policy):
    """Draws around the middle."""

    kind: Literal["noisy-v2"] = "noisy-v2"
    needs = Needs(draws=3)

    def decide(self, observed):
        return Decision(ClippedNormal(np.zeros((len(observed.step), 3)), 0.3), observed.memory)


def test_a_policy_of_a_user_is_the_same_however_it_is_given(tmp_path):
    plain = {"name": "x", "setpoints": 70, "steps": 4, "episodes": 5}
    made = ibdata.Experiment(**plain, policies=[Noisy()])
    ways = [Noisy(), {"kind": "custom", "target": Noisy()}, made.policies[0]]
    found = [ibdata.evaluate(way, steps=4, episodes=5) for way in ways]
    assert {each.results[0].policy for each in found} == set(made.labels) == {"noisy"}
    assert len({each.returns.tobytes() for each in found}) == 1
    assert found[0].notes == []


class Converted(Mine):
    def tolist(self):
        return [1, 2]


class Pair(NamedTuple):
    gain: float = 1.0
    predict = staticmethod(still)


AGENTS = {
    "tolist": Converted(),
    "named tuple": Pair(),
    "dict": type("OfDict", (Mine, dict), {})(),
    "list": type("OfList", (Mine, list), {})(),
}


@pytest.mark.parametrize("agent", AGENTS.values(), ids=AGENTS)
def test_an_object_that_acts_is_never_taken_for_data(agent):
    plain = {"name": "x", "setpoints": 70, "policies": ["random"]}
    name = type(agent).__name__.lower()
    wrapped = {"kind": "gaussian", "scale": 0.1, "base": {"kind": "custom", "target": agent}}
    made = ibdata.load({**plain, "policies": [agent]})
    for experiment in (made, ibdata.load(made), ibdata.load(plain, {"policies.0": agent})):
        assert experiment.policies[0].target is agent
        assert experiment.labels == (name,)
    for given in (agent, [agent], {name: agent}):
        assert ibdata.evaluate(given, steps=2, episodes=1).results[0].policy == name
    with pytest.raises(ConfigError, match=rf"policies\.0\.base: found {name} without deterministic"):
        ibdata.load({**plain, "policies": [wrapped]})
    for experiment in (made, {**plain, "policies": [agent]}):  # an override finds its block
        seeing = ibdata.load(experiment, {"policies.0.history": 3, "policies.0.name": "own"}).policies[0]
        assert (seeing.target, seeing.history, seeing.name) == (agent, 3, "own")


def test_objects_are_loaded_wherever_an_option_holds_them():
    class Members(Policy):
        """Acts by the first of several policies."""

        kind: Literal["members"] = "members"
        several: tuple[AnyPolicy, ...] = ()
        named: dict[str, AnyPolicy] = Field(default={})

        def decide(self, observed):
            return [*self.several, *self.named.values()][0].decide(observed)

    for policy in (Members(several=(Still(),)), Members(named={"a": Still()})):
        assert len(policy.inner) == 1
        assert ibdata.evaluate(policy, steps=2, episodes=1).results[0].clipped == 0.0
