"""The statements of docs/published.md about `IBGym`, the environment of the authors' published package."""

from __future__ import annotations

import inspect
import re
import warnings

import numpy as np
import pytest
from helpers import ROOT
from reference import published

from ibdata.environment.actions import DISCRETE
from ibdata.published import IDS, STATE_KEYS, IBGym

PAGE = (ROOT / "docs/published.md").read_text(encoding="utf-8")
TABLE, STATES = PAGE.split("## Names side by side")[1].split("## Why")[0].strip().split("\n\n")
PARTS = {name for name in vars(published.IDS) if name.startswith(("add", "update"))}
CONSTANTS = {"gsBound", "gsEnvironment", "gsScale", "gsSetPointDependency", "init", "maxRequiredStep"}


pytestmark = pytest.mark.usefixtures("global_generator")


@pytest.fixture
def wrapper():
    """An `IBGym` with discrete actions. It imports the package `gym`, which says on stderr that it is old."""
    with warnings.catch_warnings(), pytest.MonkeyPatch.context() as patch:
        warnings.simplefilter("ignore")
        patch.setattr(np, "float", float, raising=False)
        from industrial_benchmark_python.IBGym import IBGym

        return IBGym(70, "classic", "discrete", init_seed=0)


def test_the_table_has_every_published_option_and_discrete_actions_are_the_published_ones(wrapper):
    assert [tuple(action) for action in wrapper.env_action] == list(DISCRETE)
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


def test_the_states_have_the_names_of_the_table():
    cells = [line.split("|")[1:3] for line in STATES.splitlines() if "=" not in line]
    pairs = [(re.findall(r"`(\w+)`", a), re.findall(r"`(\w+)`", b)) for a, b in cells]
    table = {key: name for a, b in pairs if len(a) == len(b) > 1 for key, name in zip(a, b, strict=True)}
    assert table == {key: name for key, name in STATE_KEYS.items() if key != "coc"}


def test_ibdata_s_classes_have_all_but_what_the_page_names(wrapper):
    ours = IBGym(70, "classic", "discrete", init_seed=0)
    assert not [name for name in vars(wrapper) if not hasattr(type(ours), name) and not hasattr(ours, name)]
    theirs = set(dir(wrapper.IB))
    assert {name for name in theirs if not hasattr(ours.IB, name)} == PARTS | CONSTANTS
    assert list(ours.IB.state) == list(wrapper.IB.state)
    assert "updateFatigue" in PARTS


@pytest.mark.parametrize("name", ["IDS", "IBGym"])
def test_the_arguments_are_the_published_ones_in_their_order(name, wrapper):
    ours, theirs = {"IDS": (IDS, type(wrapper.IB)), "IBGym": (IBGym, type(wrapper))}[name]
    found, expected = (inspect.signature(each).parameters.values() for each in (ours, theirs))
    assert [x.name for x in expected] == [x.name for x in found][: len(expected)]
    kept = [(x.name, x.default) for x in expected if x.default is not x.empty]
    assert kept == [(x.name, x.default) for x in found if (x.name, x.default) in kept]
