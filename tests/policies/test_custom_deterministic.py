"""A custom policy that is said to draw nothing is held to it, and may be a base."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from helpers.custom_policies import PLAIN, described

import ibdata
from ibdata import Experiment
from ibdata.errors import ConfigError, PolicyError
from ibdata.experiment import validated

LIAR = """
import itertools
import numpy as np

calls = itertools.count()

class Liar:
    def __init__(self, changes_at):
        self.changes_at = changes_at

    def predict(self, observations):
        return np.full((len(observations), 3), 0.5 if next(calls) >= self.changes_at else 0.0)

class Still:
    def predict(self, observations):
        return observations[:, 1:4] / 200.0
"""


@pytest.fixture
def liar(mine):
    (mine / "liar_of_mine.py").write_text(LIAR)
    yield "liar_of_mine:Liar"
    sys.modules.pop("liar_of_mine", None)


def test_what_is_said_to_be_deterministic_has_a_density_and_may_be_a_base(liar):
    still = {"kind": "custom", "target": "liar_of_mine:Still", "deterministic": True}
    wrapped = [
        {"kind": "gaussian", "base": still, "scale": 0.1},
        {"kind": "epsilon_greedy", "base": still, "epsilon": 0.2},
    ]
    plain = {**described(target="x:y").plain(), "policies": [still, *wrapped]}
    made = ibdata.generate(Experiment.model_validate(plain), "out", workers=1, allow_code=True).to_pandas()
    assert (made["action_log_prob"][made["policy"] == "custom"] == 0.0).all()
    assert np.isfinite(made["action_log_prob"]).all()
    assert made["action_log_prob"].nunique() > 2


def test_what_answers_otherwise_when_asked_again_is_refused(liar):
    options = {"target": liar, "params": {"changes_at": 4}, "deterministic": True}
    with pytest.raises(PolicyError, match=r"^policy custom: found other actions when the same was asked"):
        ibdata.generate(described(**options), "out", workers=1, allow_code=True)


@pytest.mark.parametrize(
    ("block", "line"),
    [
        (
            {"deterministic": True, "uniforms": 3},
            "found deterministic: true and uniforms: 3, expected only one",
        ),
        ({"deterministic": 1}, "found 1, expected true or false"),
    ],
)
def test_what_draws_is_not_deterministic(block, line):
    with pytest.raises(ConfigError, match=line):
        validated({**PLAIN, "policies": [{"kind": "custom", "target": "a:b", **block}]})


def test_a_base_without_the_word_is_refused_in_one_line():
    block = {"kind": "gaussian", "base": {"kind": "custom", "target": "a:b"}, "scale": 1.0}
    with pytest.raises(
        ConfigError, match=r"base: found custom without deterministic: true, expected a policy th"
    ):
        validated({**PLAIN, "policies": [block]})
