"""The statements of docs/environment.md about `IBGym`, the environment of the authors' published package."""

from __future__ import annotations

import inspect
import re
import warnings

import numpy as np
import pytest
from helpers import ROOT
from reference import published

from ibdata.environment.actions import DISCRETE

PAGE = (ROOT / "docs/environment.md").read_text(encoding="utf-8")
TABLE = PAGE[PAGE.index("| `IBGym` | ibdata |") : PAGE.index("What is different:")]


@pytest.fixture(scope="module")
def wrapper():
    """An `IBGym` with discrete actions. It imports the package `gym`, which says on stderr that it is old."""
    before = np.random.get_state()  # noqa: NPY002
    with warnings.catch_warnings(), pytest.MonkeyPatch.context() as patch:
        warnings.simplefilter("ignore")
        patch.setattr(np, "float", float, raising=False)
        from industrial_benchmark_python.IBGym import IBGym

        made = IBGym(70, "classic", "discrete", init_seed=0)
    np.random.set_state(before)  # noqa: NPY002
    return made


def test_discrete_actions_are_those_of_the_published_one(wrapper):
    assert [tuple(action) for action in wrapper.env_action] == list(DISCRETE)


def test_the_table_has_every_published_option(wrapper):
    theirs = "".join(line.split("|")[1] for line in TABLE.strip().splitlines() if "|" in line)
    options = [name for name in inspect.signature(type(wrapper)).parameters if name != "self"]
    assert sorted(options) == sorted(set(re.findall(r"`(\w+)=", theirs)))


def test_the_hidden_variables_have_the_names_of_the_table(wrapper):
    """Each is given a value of its own, and stands under both names of the table."""
    (row,) = re.findall(r"^\| the hidden state.*$", TABLE, flags=re.MULTILINE)
    theirs, ours = (re.findall(r"`(\w+)`", part) for part in row.replace("`info`", "").split("|")[1:3])
    theirs[:2], ours[:2] = ([f"op_cost_t{i}" for i in range(9)], [f"latent_theta_{9 - i}" for i in range(9)])
    values = {f"latent_theta_{lag}": lag for lag in range(1, 10)}
    wrapper.IB.state["o"] = np.arange(9.0, -1.0, -1.0)  # the oldest first
    for i, name in enumerate(("domain", "response", "direction", "mu_v", "mu_g"), start=20):
        values[f"latent_{name}"] = wrapper.IB.state[published.SAME[name]] = i
    info = wrapper._markovian_state()
    assert {name: info[name] for name in theirs} == {a: values[b] for a, b in zip(theirs, ours, strict=True)}
    assert set(values) == set(ours)
