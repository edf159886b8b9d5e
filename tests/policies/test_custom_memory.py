"""Custom policies with memory give the same data whatever the files and workers."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from helpers.custom_policies import PLAIN

import ibdata
from ibdata.errors import PolicyError
from ibdata.experiment import validated

REMEMBERING = """
import numpy as np
from ibdata.policies import Decision, Needs, Policy

class Deciding(Policy):
    kind: str = "deciding"
    needs = Needs(step_draws=3, episode_draws=1, memory=3)
    theta: float = 0.15

    def decide(self, given):
        centre = given.episode_uniforms - 0.5
        x = (1.0 - self.theta) * given.memory + 0.2 * (2.0 * given.uniforms - 1.0)
        return Decision(centre + x, x)

    def log_density(self, given, action):
        return given.memory[:, 0] + action[:, 0]

class Resetting:
    def reset(self, n):
        self.x = np.zeros((n, 3))

    def act(self, history, u):
        self.x = 0.85 * self.x + 0.2 * (2.0 * u - 1.0)
        return self.x

class Leaking(Resetting):
    def reset(self, n):
        self.x = getattr(self, "x", np.zeros((n, 3)))

class Recurrent:
    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        cell, hidden = state or np.full((2, 2, len(observation), 3), 9.0)
        cell, hidden = (np.where(episode_start[:, None], 0.0, x) for x in (cell, hidden))
        cell = 0.9 * cell + 0.001 * observation[:, 1:4]
        hidden = 0.5 * hidden + cell
        return hidden[0] - 0.5 * deterministic, (cell, hidden)
"""


@pytest.fixture
def remembering(mine):
    """Make a dataset of two policies, of which one remembers in files of so many rows."""
    (mine / "remembering.py").write_text(REMEMBERING)

    def make(name, rows=100, workers=1, **options):
        block = {"kind": "custom", "target": f"remembering:{name}", **options}
        sticky = {"kind": "sticky", "base": block, "kappa": 0.3}
        plain = {**PLAIN, "setpoints": [20, 70], "policies": [block, sticky], "episodes": 3, "steps": 12}
        experiment = validated({**plain, "output": {"shard_rows": rows}})
        out = f"{name}-{rows}-{workers}"
        return ibdata.generate(experiment, out, workers=workers, allow_code=True)

    yield make
    sys.modules.pop("remembering", None)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("Deciding", {"uniforms": 3, "params": {"theta": 0.3}}),
        ("Resetting", {"uniforms": 3}),
        ("Recurrent", {"deterministic": True}),
    ],
)
def test_what_is_remembered_in_the_open_has_one_root_over_files_and_repair(
    remembering, shard_file, mine, name, options
):
    together, apart = remembering(name, **options), remembering(name, rows=36, **options)
    assert together.content_root == apart.content_root
    assert (len(together.manifest["shards"]), len(apart.manifest["shards"])) == (2, 4)
    lost = shard_file(apart.path, 2)
    (apart.path / lost).unlink()
    assert ibdata.repair(apart.path, workers=1, allow_code=True) == [lost]
    known = np.isfinite(apart.to_pandas()["action_log_prob"])
    assert known.any() == (name != "Resetting")


@pytest.mark.slow
def test_what_is_remembered_has_one_root_over_workers(remembering):
    roots = {
        remembering("Resetting", rows=36, workers=workers, uniforms=3).content_root for workers in (1, 2, 3)
    }
    assert len(roots) == 1


def test_what_leaks_from_one_episode_into_the_next_is_refused(remembering):
    with pytest.raises(
        ibdata.IbdataError,
        match="policy custom: found other actions when the same was asked again, .*; "
        r"memory must be returned by decide, be the state of predict, or begin anew in reset\(n\)",
    ):
        remembering("Leaking", uniforms=3)


def test_an_object_with_decide_says_which_option_is_too_small(remembering):
    line = "found uniforms: 0, expected at least the needs of Deciding; write uniforms: 3"
    with pytest.raises(PolicyError, match=line):
        remembering("Deciding")
