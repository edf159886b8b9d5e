"""Rules for every policy, and that a new policy needs only one file."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from helpers.asking import log_density_of
from pydantic import ValidationError

import ibdata
from ibdata.experiment import Experiment, as_yaml, load
from ibdata.policies import POLICIES, Decision, Deterministic, Observed, Policy, Wrapper
from ibdata.policies.choice import Choice
from ibdata.testing import check_policy


def needs_options(kind):
    return any(field.is_required() for field in POLICIES[kind].model_fields.values())


ALONE = [kind for kind in POLICIES if not needs_options(kind)]
# Options to try for each kind that has any to give, all of them different from their defaults.
CUSTOM = {"target": "ibdata.policies.safe:Safe", "uniforms": 5}  # code that everyone has
SURE = {"target": "ibdata.policies.mediocre:Mediocre", "deterministic": True}
EXAMPLES = {
    "constant": [{}, {"action": [1.0, -0.25, 0.1]}],
    "custom": [CUSTOM, SURE],
}
# Around every policy that may be a base, but multisine, which is like prbs; 24 nodes integrate a normal of
# 0.4 to 1e-7.
PLAIN = [k for k in ALONE if not issubclass(POLICIES[k], Wrapper | Choice) and k != "multisine"]
FIXED = [kind for kind in PLAIN if issubclass(POLICIES[kind], Deterministic)]
EXAMPLES["epsilon_greedy"] = [
    *({"base": {"kind": kind}, "epsilon": 0.2} for kind in PLAIN),
    *(
        {"base": {"kind": kind}, "epsilon": epsilon}
        for kind in ("safe", "mediocre")
        for epsilon in (0.0, 1.0)
    ),
    {"base": {"kind": "constant", "action": [1.0, -0.25, 0.1]}, "epsilon": 0.4},
    {"base": {"kind": "custom", **SURE}, "epsilon": 0.4},
]
EXAMPLES["gaussian"] = [
    *({"base": {"kind": kind}, "scale": 0.4} for kind in FIXED),
    {"base": {"kind": "custom", **SURE}, "scale": 0.4},
]
NOISE = {"base": {"kind": "constant", "action": [0.5, -0.25, 1.0]}}
EXAMPLES["ornstein_uhlenbeck"] = [{}, {**NOISE, "theta": 0.5, "sigma": 0.4}]
EXAMPLES["coloured_noise"] = [{"period": 8}, {**NOISE, "beta": 0.5, "scale": 2.0, "period": 2}]
EXAMPLES["prbs"] = [{}, {"order": 3, "hold": 1, "amplitude": 0.25}]
EXAMPLES["multisine"] = [{}, {"sines": 2, "period": 16, "amplitude": 0.5}]
EXAMPLES["sticky"] = [
    {"base": {"kind": "random"}, "kappa": 0.5},
    {"base": {"kind": "optimized"}, "kappa": 0.5},
    {"base": {"kind": "custom", **SURE}, "kappa": 0.5},
    {"base": {"kind": "epsilon_greedy", "base": {"kind": "prbs"}, "epsilon": 0.4}, "kappa": 0.25},
    {"base": {"kind": "sticky", "base": {"kind": "safe"}, "kappa": 0.5}, "kappa": 0.5},
]
EXAMPLES["mixture"] = [
    {"bases": [{"kind": "safe"}, {"kind": "optimized"}, {"kind": "random"}]},
    {"bases": [{"kind": "coloured_noise", "period": 8}, {"kind": "prbs"}], "weights": [1.0, 3.0]},
    {"bases": [{"kind": "sticky", "base": {"kind": "ornstein_uhlenbeck"}, "kappa": 0.5}, {"kind": "bad"}]},
]
EXAMPLES["schedule"] = [
    {"stages": [{"base": {"kind": "safe"}, "steps": 2}, {"base": {"kind": "ornstein_uhlenbeck"}}]},
    {"stages": [{"base": {"kind": "bad"}, "steps": 20, "epsilon": [1.0, 0.0]}]},
    {
        "stages": [
            {"base": {"kind": "sticky", "base": {"kind": "random"}, "kappa": 0.5}, "epsilon": [0.5, 0.5]}
        ]
    },
]
# A policy that needs options and has no example here calls `check_policy` in its own test.
CASES = [
    (kind, options) for kind in POLICIES for options in EXAMPLES.get(kind, [{}] if kind in ALONE else [])
]
IDS = [f"{kind}-{json.dumps(options)}" for kind, options in CASES]
policies = pytest.mark.parametrize("policy", [POLICIES[kind](**options) for kind, options in CASES], ids=IDS)
EDGES = (0.0, 20.0, 39.999996, 40.0, 50.0, 60.0, 60.000004, 80.0, 100.0)
SMALLEST, LARGEST = 2.0**-53, 1.0 - 2.0**-53


def histories(policy, values=EDGES):
    """One lane (n, frames, 6) for every pair of velocity and gain, the older frames those of other lanes."""
    pairs = np.array(list(product(values, values)), dtype=np.float32)
    history = np.full((len(pairs), policy.needs.history, 6), 50.0, dtype=np.float32)
    for k in range(policy.needs.history):
        history[:, k, 1:3] = np.roll(pairs, k, axis=0)
        history[:, k, 3:5] = np.roll(pairs[::-1], 2 * k, axis=0)
    return history


def draws(n, count):
    u = np.random.default_rng(0).random((n, count))
    u[: n // 4][u[: n // 4] < 0.5] = SMALLEST
    u[n // 4 : n // 2][u[n // 4 : n // 2] > 0.5] = LARGEST
    return u


def applied(policy, given):
    """The action as it is applied and stored: clipped and rounded to float32."""
    return np.clip(np.asarray(policy.decide(given).actions), -1.0, 1.0).astype(np.float32)


def asked(policy, history, step=3):
    """What a policy is given at a step of episodes with these histories, after it has played the others."""
    n, frames = history.shape[:2]
    random = np.random.default_rng(1)
    done, memory = np.zeros((n, frames, 3), dtype=np.float32), np.zeros((n, policy.needs.memory))
    drawn = random.random((n, policy.needs.episode_draws))
    for t in range(step):
        u = random.random((n, policy.needs.step_draws))
        given = Observed(history, done, np.full(n, t), u, drawn, memory)
        memory = np.asarray(policy.decide(given).memory)
        done = np.concatenate([applied(policy, given)[:, None], done], axis=1)[:, :frames]
    return Observed(history, done, np.full(n, step), draws(n, policy.needs.step_draws), drawn, memory)


def repeated(given, times):
    return given.apply(lambda x: np.repeat(x, times, axis=0))


def read_only(array):
    array = array.copy()
    array.flags.writeable = False
    return array


def test_every_example_is_of_a_policy_that_there_is():
    assert set(EXAMPLES) <= set(POLICIES)
    assert {"constant", "random", "safe", "optimized", "epsilon_greedy", "gaussian"} <= set(POLICIES)


@pytest.mark.parametrize(("kind", "options"), CASES, ids=IDS)
def test_a_policy_stands_under_its_own_kind(kind, options):
    assert POLICIES[kind](**options).kind == kind


@pytest.mark.slow
@policies
def test_a_policy_passes_the_checks_that_are_published_for_everybody(policy):
    check_policy(policy)
    check_policy(policy, histories(policy))


@policies
def test_its_own_actions_have_a_finite_log_density(policy):
    given = repeated(asked(policy, histories(policy)), 20)
    given = given._replace(uniforms=draws(len(given.step), policy.needs.step_draws))
    density = policy.log_density(given, applied(policy, given))
    assert np.isfinite(density[~unknown(policy, given)]).all()
    assert np.isnan(density[unknown(policy, given)]).all()


@policies
def test_arrays_that_cannot_be_written_are_enough(policy):
    given = asked(policy, histories(policy))
    action = applied(policy, given)
    seen, done = given.apply(read_only), read_only(action)
    for a, b in zip(policy.decide(seen), policy.decide(given), strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(policy.log_density(seen, done), policy.log_density(given, action))


def unknown(policy, given):
    """Whether no density is known in each episode (n,): that of coloured noise is not."""
    if policy.kind == "mixture":
        kinds = np.array([base.kind for base in policy.bases])
        return kinds[policy.chosen(given)] == "coloured_noise"
    return np.full(len(given.step), policy.kind == "coloured_noise")


@policies
def test_a_policy_survives_a_dump_and_a_config(policy, tmp_path):
    assert type(policy).model_validate(policy.model_dump()) == policy
    assert type(policy).model_validate_json(policy.model_dump_json()) == policy
    experiment = Experiment(name="x", setpoints=70.0, policies=[policy])
    (tmp_path / "x.yaml").write_bytes(as_yaml(experiment))
    assert load(tmp_path / "x.yaml").policies == [policy]


@policies
def test_a_policy_never_changes(policy):
    with pytest.raises(ValidationError, match="frozen"):
        policy.name = "other"
    with pytest.raises(ValidationError, match="frozen"):
        policy.kind = "other"


@policies
def test_an_unknown_option_is_refused(policy):
    with pytest.raises(ValidationError, match="extra_forbidden"):
        type(policy)(unknown=1)


@pytest.mark.parametrize("kind", [kind for kind, options in CASES if not options])
def test_the_form_leaves_out_the_name_and_what_equals_its_default(kind):
    default = POLICIES[kind]()
    spelt_out = POLICIES[kind](**default.model_dump(exclude={"name"}), name="a-name")
    assert spelt_out.form() == default.form() == {"kind": kind}


@pytest.mark.parametrize(("kind", "options"), CASES, ids=IDS)
def test_the_form_holds_every_option_that_differs_as_json(kind, options):
    form = POLICIES[kind](**options, name="a-name").form()
    assert json.loads(json.dumps(form)) == {"kind": kind, **options}


@policies
def test_the_label_is_the_name_where_there_is_one_else_the_kind(policy):
    assert policy.label == policy.kind
    assert policy.model_copy(update={"name": "mine"}).label == "mine"


def test_a_policy_that_gives_no_density_has_nan():
    class Silent(Policy):
        kind: str = "silent"

        def decide(self, given):
            return Decision(np.zeros((len(given.step), 3)), given.memory)

    density = log_density_of(Silent(), np.zeros((4, 1, 6), np.float32), np.zeros((4, 3), np.float32))
    assert np.isnan(density).all()
    assert density.shape == (4,)


RAMP = '''
"""Turns every knob up by the same amount."""

from typing import ClassVar, Literal

import numpy as np

from ibdata.policies.base import Decision, Needs, Policy


class Ramp(Policy):
    """A slope, and a little noise."""

    needs: ClassVar[Needs] = Needs(step_draws=1)
    kind: Literal["ramp"] = "ramp"
    slope: float = 0.25

    def decide(self, given):
        return Decision(np.full((len(given.step), 3), self.slope) + 0.0 * given.uniforms, given.memory)
'''
CONFIG = "name: x\nsetpoints: 70\nsteps: 3\npolicies: [{kind: %s, slope: 0.5}]\n"
CHILD = """
import json
from ibdata.errors import ConfigError
from ibdata.experiment import load
from ibdata.experiment.rollout import rollout
columns = rollout(load("ramp.yaml"), 0, 1)
actions = [columns.table[columns.names.index(f"act_{x}")].tolist() for x in ("velocity", "gain", "shift")]
try:
    load("wrong.yaml")
except ConfigError as error:
    print(json.dumps([actions, str(error)]))
"""


def test_a_file_in_the_folder_is_all_it_takes_to_add_a_policy(tmp_path):
    """The interpreted package, since a new file would have everything compiled anew."""
    package = Path(ibdata.__file__).parent
    shutil.copytree(package, tmp_path / "ibdata", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "ibdata" / "policies" / "ramp.py").write_text(RAMP)
    (tmp_path / "ramp.yaml").write_text(CONFIG % "ramp")
    (tmp_path / "wrong.yaml").write_text(CONFIG % "rmp")
    variables = {
        "PYTHONPATH": str(tmp_path),
        "NUMBA_DISABLE_JIT": "1",
        "IBDATA_CACHE_DIR": str(tmp_path / "c"),
    }
    child = subprocess.run(
        [sys.executable, "-W", "error", "-c", CHILD],
        cwd=tmp_path,
        env=os.environ | variables,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert child.returncode == 0, child.stderr
    actions, message = json.loads(child.stdout)
    assert actions == [[0.5] * 3] * 3
    kinds = ", ".join(sorted([*POLICIES, "ramp"]))
    assert message == (
        f"wrong.yaml:4:19: policies.0.kind: found 'rmp', expected one of {kinds}; did you mean 'ramp'?"
    )
