"""Cells: their order, labels, setpoints and variants, and the digests on which their random numbers depend.

The golden digests are the SHA-256 of the forms beside them, printed by

    printf %s 'FORM' | sha256sum

Neither the digests nor the forms may ever change, because the random numbers of all datasets depend on them.
"""

from __future__ import annotations

import hashlib
import math

import pytest
from helpers.refusals import refused

from ibdata.experiment import Experiment, load

RANDOM = {"kind": "random"}
SAFE = {"kind": "safe"}
NUDGE = {"kind": "constant", "action": [0.5, -1, 0.1]}
GREEDY = {"kind": "epsilon_greedy", "base": {"kind": "optimized"}, "epsilon": 0.2}

# dynamics, setpoints, policy, start: the canonical form as JSON, and its SHA-256.
GOLDEN = {
    "random": (
        ("siemens", 70, RANDOM, "default"),
        '{"dynamics": "siemens", "policy": {"kind": "random"}, "setpoint": "0x1.1800000000000p+6", '
        '"start": "default"}',
        "42783eeed6ee54d3380f85ab8b691a1f9b5ebe334180a048cc70643d9fa7c861",
    ),
    "drifting": (
        ("siemens", {"drifting": 0.1}, RANDOM, "default"),
        '{"dynamics": "siemens", "policy": {"kind": "random"}, '
        '"setpoint": {"drifting": "0x1.999999999999ap-4"}, "start": "default"}',
        "801034c286d136e01336a6113f8256069757bd25a2a44ef3557d6590177e3c8d",
    ),
    "everything else": (
        ({"base": "paper", "drift_length": 7, "eta_mean": 1}, 100, NUDGE, {"burn_in": [15, 64]}),
        '{"dynamics": {"base": "paper", "drift_length": 7, "eta_mean": 1.0}, '
        '"policy": {"action": [0.5, -1.0, 0.1], "kind": "constant"}, '
        '"setpoint": "0x1.9000000000000p+6", "start": {"burn_in": [15, 64]}}',
        "e98625a22f9bc0c1419149b209a3c67e23a6fd961a3c53ebbb80dd06cee43e0d",
    ),
    "noise around a baseline": (
        ("siemens", 70, {"kind": "gaussian", "base": NUDGE, "scale": 0.25}, "default"),
        '{"dynamics": "siemens", "policy": {"base": {"action": [0.5, -1.0, 0.1], "kind": "constant"}, '
        '"kind": "gaussian", "scale": 0.25}, "setpoint": "0x1.1800000000000p+6", "start": "default"}',
        "0a6a3cafedb405722b640c2195b1db475c68f1c762e6ea97b9229721266f9b9c",
    ),
}


def experiment(**fields):
    return Experiment(**{"name": "x", "setpoints": 70, "policies": [RANDOM], **fields})


def digests(**fields):
    return [cell.digest for cell in experiment(**fields).cells]


def setpoints(value):
    return [cell.setpoint for cell in experiment(setpoints=value).cells]


@pytest.mark.parametrize(("fields", "form", "digest"), GOLDEN.values(), ids=GOLDEN)
def test_the_digest_of_a_cell_never_changes(fields, form, digest):
    dynamics, setpoint, policy, start = fields
    made = digests(dynamics=dynamics, setpoints=setpoint, policies=[policy], start=start)
    assert [x.hex() for x in made] == [digest]
    assert hashlib.sha256(form.encode()).hexdigest() == digest


def test_one_cell_said_in_two_ways_has_one_digest():
    spelt_out = {"kind": "constant", "action": [0, 0, 0]}
    for wrapped in (lambda base: base, lambda base: {"kind": "gaussian", "base": base, "scale": 1}):
        assert digests(policies=[wrapped("constant")]) == digests(policies=[wrapped(spelt_out)])
    assert digests(setpoints=-0.0) == digests(setpoints=0.0)  # they give the same data


def test_cells_are_ordered_by_policy_and_depend_on_nothing_else():
    cells = experiment(setpoints=[70, 10], policies=[SAFE, RANDOM]).cells
    found = [(cell.label, cell.setpoint) for cell in cells]
    assert found == [("safe", 70.0), ("safe", 10.0), ("random", 70.0), ("random", 10.0)]
    assert cells[2].digest == digests()[0]


def test_whatever_changes_the_cell_changes_its_digest():
    policies = [NUDGE, {**NUDGE, "action": [0.5, -1, 0.2]}, GREEDY, {**GREEDY, "base": {"kind": "bad"}}]
    dynamics = ["paper", {"base": "paper", "eta_mean": 0.1}, {"base": "siemens", "eta_mean": 0.2}]
    changes = [
        {},
        *({"setpoints": x} for x in (71, math.nextafter(70.0, 71.0), {"drifting": 70}, {"drifting": 71})),
        *({"policies": [x]} for x in policies),
        *({"start": x} for x in ("uniform", {"burn_in": [0, 0]}, {"burn_in": [0, 1]})),
        *({"dynamics": x} for x in dynamics),
    ]
    assert len({digests(**change)[0] for change in changes}) == len(changes)


def constants(*names):
    named = ({"name": name} if name else {} for name in names)
    return [{"kind": "constant", "action": [i / 10, 0, 0], **name} for i, name in enumerate(named)]


@pytest.mark.parametrize(
    ("names", "labels"),
    [
        (("a", None, "a", None), ("a", "constant", "a-2", "constant-2")),
        ((None, "constant"), ("constant", "constant-2")),
        (("a", "a-2", "a"), ("a", "a-2", "a-3")),
        (("a", "a", "a-2"), ("a", "a-2", "a-2-2")),
    ],
)
def test_later_policies_with_the_same_label_are_numbered(names, labels):
    assert experiment(policies=constants(*names)).labels == labels


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (70, [70.0]),
        ([30, 10.5], [30.0, 10.5]),
        ("drifting", [50.0]),
        ({"drifting": 20}, [20.0]),
        ({"drifting": [10, 50]}, [10.0, 50.0]),
        ({"start": 10, "stop": 100, "step": 10}, [10.0 * i for i in range(1, 11)]),
        ({"start": 10, "stop": 35, "step": 10}, [10.0, 20.0, 30.0]),
        ({"start": 10, "stop": 10, "step": 3}, [10.0]),
        ({"start": 0, "stop": 1, "step": 0.1}, [i / 10 for i in range(11)]),  # 0.3, not 0.30000000000000004
        ({"start": 0, "stop": 100, "step": 100 / 3}, [0.0, 100 / 3, 200 / 3]),
    ],
)
def test_each_form_of_setpoints_gives_its_numbers(value, expected):
    assert setpoints(value) == expected
    assert {type(x) for x in setpoints(value)} == {float}


@pytest.mark.parametrize(
    ("episodes", "ranges"),
    [
        (100, {"train": (0, 89), "validation": (90, 99)}),
        (5, {"train": (0, 3), "validation": (4, 4)}),
        (2, {"train": (0, 0), "validation": (1, 1)}),
    ],
)
def test_shares_of_splits_are_ranges_that_do_not_meet(episodes, ranges):
    splits = {"train": {"episodes": "first 90%"}, "validation": {"episodes": "last 10 %"}}
    made = experiment(episodes=episodes, splits=splits).splits
    found = {name: split.indices(episodes) for name, split in made.items()}
    assert {name: (held.start, held.stop - 1) for name, held in found.items()} == ranges


@pytest.mark.parametrize(
    "split",
    [
        {"episodes": "last 10%"},
        {"episodes": {"start": 1, "stop": 1}},
        {"episodes": {"start": 1, "stop": 0}},
        {"episodes": 2},
        {"setpoint": [70, 71]},
        {"setpoint": []},
        {"policy": ["random", "safe"]},
        {"policy": []},
    ],
    ids=str,
)
def test_a_declared_split_without_an_episode_is_refused(split):
    splits = {"train": {"episodes": "first 90%"}, "held": {**split, "overlap": True}}
    refused(r"splits\.held\.(episodes|setpoint|policy): found .*, expected", experiment, splits=splits)


def test_shares_of_splits_are_those_of_the_episodes_that_are_made():
    small = experiment(
        episodes=10, splits={"train": {"episodes": "first 80%"}, "test": {"episodes": "last 20%"}}
    )
    for large in (load(small, {"episodes": 100}), small.model_copy(update={"episodes": 100})):
        assert [len(split.indices(large.episodes)) for split in large.splits.values()] == [80, 20]
