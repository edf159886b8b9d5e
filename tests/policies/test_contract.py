"""Rules for every policy, and that a new policy needs only one file."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.policies import BLOCKS, policy_of
from pydantic import ValidationError

import ibdata
from ibdata.experiment import Experiment, as_yaml, load
from ibdata.plan.dataset_spec import DatasetSpec
from ibdata.policies import POLICIES
from ibdata.testing import check_policy

pytestmark = pytest.mark.usefixtures("network_here")


FITTING = {
    "sines": {"period": 10_000},
    "period": {"sines": 1},
}  # of multisine, whose options limit each other


def at_both_ends():
    """Policies of all kinds, each with one number at the end of its range, or just inside of an open end.

    Numbers of `custom` say only what a user's code is given.
    """
    for block in {block["kind"]: block for block in reversed(BLOCKS) if block["kind"] != "custom"}.values():
        for name, option in POLICIES[block["kind"]].model_fields.items():
            others = FITTING.get(name, {}) if block["kind"] == "multisine" else {}
            for end in option.metadata:
                for bound, inside in (("ge", 0), ("le", 0), ("gt", 1e-12)):
                    if hasattr(end, bound):
                        changed = {**block, **others, name: getattr(end, bound) + inside}
                        yield pytest.param(changed, id=f"{block['kind']}-{name}-{bound}")
    yield {"kind": "mixture", "bases": ["random", "bad"], "weights": [1e-12, 1e9]}
    yield {"kind": "schedule", "stages": [{"base": "bad", "steps": 6, "epsilon": [0.0, 1.0]}]}


@pytest.mark.slow
@pytest.mark.parametrize("block", [*BLOCKS, *at_both_ends()])
def test_it_passes_the_published_checks_also_at_both_ends_of_each_option(block):
    check_policy(policy_of(block))


@pytest.mark.parametrize("block", BLOCKS)
def test_it_is_an_immutable_block_that_shows_what_differs_from_defaults(block, tmp_path):
    policy = policy_of(block)
    made = Experiment(name="x", setpoints=70.0, policies=[policy])
    assert type(policy).model_validate_json(policy.model_dump_json(), context=made.checked_with) == policy
    for name, data in DatasetSpec.of(made).weights.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "x.yaml").write_bytes(as_yaml(made))
    assert load(tmp_path / "x.yaml").policies == [policy]
    with pytest.raises(ValidationError, match="frozen"):
        policy.kind = "other"
    with pytest.raises(ValidationError, match="extra_forbidden"):
        type(policy)(unknown=1)
    named = policy.model_copy(update={"name": "mine"})
    assert (policy.label, named.label, named.form()) == (block["kind"], "mine", policy.form())
    if "actor.safetensors" not in json.dumps(block):  # which the form names by its hash
        assert json.loads(json.dumps(policy.form())) == block
    if set(block) == {"kind"}:
        assert policy_of({**block, **policy.model_dump(exclude={"name"})}).form() == block


RAMP = '''
"""Turns every knob up by the same amount."""

from typing import ClassVar, Literal

import numpy as np

from ibdata.policies.base import Decision, Needs, Policy


class Ramp(Policy):
    """A slope, and a little noise."""

    needs: ClassVar[Needs] = Needs(draws=1)
    kind: Literal["ramp"] = "ramp"
    slope: float = 0.25

    def decide(self, given):
        return Decision(np.full((len(given.step), 3), self.slope) + 0.0 * given.draws, given.memory)
'''
CHILD = """
from ibdata.experiment import Experiment
from ibdata.plan.rollout import rollout
made = rollout(Experiment(name="x", setpoints=70, steps=3, policies=[{"kind": "ramp", "slope": 0.5}]), 0, 1)
print([made.table[made.names.index(f"act_{x}")].tolist() for x in ("velocity", "gain", "shift")])
"""


@pytest.mark.slow
def test_a_file_in_the_folder_is_all_a_new_policy_takes(tmp_path):
    """The interpreted package, since a new file would have everything compiled anew."""
    package = Path(ibdata.__file__).parent
    shutil.copytree(package, tmp_path / "ibdata", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "ibdata/policies/ramp.py").write_text(RAMP)
    env = os.environ | {
        "PYTHONPATH": str(tmp_path),
        "NUMBA_DISABLE_JIT": "1",
        "IBDATA_CACHE_DIR": str(tmp_path),
    }
    command = [sys.executable, "-W", "error", "-c", CHILD]
    child = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=120)
    assert (child.stderr, child.stdout.strip()) == ("", str([[0.5] * 3] * 3))
