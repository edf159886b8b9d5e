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
from pydantic import ValidationError

import ibdata
from ibdata.experiment import Experiment, as_yaml, load
from ibdata.policies import POLICIES, Deterministic, Policy, Wrapper
from ibdata.policies.base import is_deterministic
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
# Around every policy that may be a base; 24 nodes integrate a normal of 0.4 to 1e-7.
PLAIN = [kind for kind in ALONE if not issubclass(POLICIES[kind], Wrapper)]
FIXED = [kind for kind in PLAIN if issubclass(POLICIES[kind], Deterministic)]
EXAMPLES["epsilon_greedy"] = [
    *({"base": {"kind": kind}, "epsilon": 0.2} for kind in PLAIN),
    *({"base": {"kind": kind}, "epsilon": 0.6, "per_dimension": True} for kind in FIXED),
    *(
        {"base": {"kind": kind}, "epsilon": epsilon}
        for kind in ("safe", "mediocre")
        for epsilon in (0.0, 1.0)
    ),
    {"base": {"kind": "constant", "action": [1.0, -0.25, 0.1]}, "epsilon": 0.4},
    {"base": {"kind": "custom", **SURE}, "epsilon": 0.4, "per_dimension": True},
]
EXAMPLES["gaussian"] = [
    *({"base": {"kind": kind}, "scale": 0.4} for kind in FIXED),
    {"base": {"kind": "custom", **SURE}, "scale": 0.4},
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
    history = np.full((len(pairs), policy.history_length, 6), 50.0, dtype=np.float32)
    for k in range(policy.history_length):
        history[:, k, 1:3] = np.roll(pairs, k, axis=0)
        history[:, k, 3:5] = np.roll(pairs[::-1], 2 * k, axis=0)
    return history


def draws(policy, n):
    u = np.random.default_rng(0).random((n, policy.uniforms_per_step))
    u[: n // 4][u[: n // 4] < 0.5] = SMALLEST
    u[n // 4 : n // 2][u[n // 4 : n // 2] > 0.5] = LARGEST
    return u


def applied(policy, history, u):
    """The action as it is applied and stored: clipped and rounded to float32."""
    return np.clip(np.asarray(policy.act(history, u)), -1.0, 1.0).astype(np.float32)


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


@policies
def test_a_policy_passes_the_checks_that_are_published_for_everybody(policy):
    check_policy(policy)
    check_policy(policy, histories(policy))


@policies
def test_its_own_actions_have_a_finite_log_density(policy):
    history = np.repeat(histories(policy), 20, axis=0)
    action = applied(policy, history, draws(policy, len(history)))
    assert np.isfinite(policy.log_prob(history, action)).all()


@policies
def test_arrays_that_cannot_be_written_are_enough(policy):
    history = histories(policy)
    u = draws(policy, len(history))
    action = applied(policy, history, u)
    seen, drawn, done = read_only(history), read_only(u), read_only(action)
    np.testing.assert_array_equal(policy.act(seen, drawn), policy.act(history, u))
    np.testing.assert_array_equal(policy.log_prob(seen, done), policy.log_prob(history, action))


def atoms_of(policy, lane, dimension):
    """±1 and the actions that a state repeats: the points of the measure of `Policy.log_prob`."""
    many = np.repeat(lane, 400, axis=0)
    values, counts = np.unique(
        applied(policy, many, np.random.default_rng(1).random((400, policy.uniforms_per_step)))[:, dimension],
        return_counts=True,
    )
    return sorted({-1.0, 1.0} | set(values[counts > 4].tolist()))


def whole_atom(policy, lane):
    """The one action (1, 3) that has a mass of its own as a whole, or none (0, 3)."""
    whole = policy.kind == "epsilon_greedy" and not policy.per_dimension and policy.epsilon < 1.0
    if whole and is_deterministic(policy.base):
        return policy.base.mean_action(lane)
    return np.empty((0, 3), dtype=np.float32)


@policies
def test_the_density_integrates_to_1_in_every_state(policy):
    """Gauss-Legendre on (-1, 1) and unit masses at the atoms, over the product of the dimensions."""
    nodes, node_weights = np.polynomial.legendre.leggauss(24)
    for i, _ in enumerate(history := histories(policy, (20.0, 40.0, 50.0, 60.0, 80.0))):
        lane = history[i : i + 1]
        whole = whole_atom(policy, lane)
        axes, weights = [], []
        for dimension in range(3):
            atoms = [-1.0, 1.0] if len(whole) else atoms_of(policy, lane, dimension)
            axes.append(np.concatenate([nodes, atoms]))
            weights.append(np.concatenate([node_weights, np.ones(len(atoms))]))
        action = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.float32)
        weight = np.einsum("i,j,k->ijk", *weights).ravel()
        if len(whole) and not (np.abs(whole) == 1.0).all():  # else it is on the grid already
            action, weight = np.concatenate([action, whole]), np.append(weight, 1.0)
        density = np.exp(policy.log_prob(np.repeat(lane, len(action), axis=0), action))
        assert (density * weight).sum() == pytest.approx(1.0, abs=1e-6), lane[0, 0].tolist()


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

        def act(self, history, u):
            return np.zeros((len(history), 3))

    density = Silent().log_prob(np.zeros((4, 1, 6), np.float32), np.zeros((4, 3), np.float32))
    assert np.isnan(density).all()
    assert density.shape == (4,)


RAMP = '''
"""Turns every knob up by the same amount."""

from typing import ClassVar, Literal

import numpy as np

from ibdata.policies.base import Policy


class Ramp(Policy):
    """A slope, and a little noise."""

    uniforms_per_step: ClassVar[int] = 1
    kind: Literal["ramp"] = "ramp"
    slope: float = 0.25

    def act(self, history, u):
        return np.full((len(history), 3), self.slope) + 0.0 * u
'''
CONFIG = "name: x\nsetpoints: 70\nsteps: 3\npolicies: [{kind: %s, slope: 0.5}]\n"
CHILD = """
import json
from ibdata.errors import ConfigError
from ibdata.experiment import load
from ibdata.simulation.rollout import rollout
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
