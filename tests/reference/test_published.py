"""Both variants against another implementation each, on one tape of random numbers.

`siemens` is compared with the authors' published package, `paper` with a second implementation of the printed
equations.
"""

from __future__ import annotations

import numpy as np
import pytest
from helpers import FULL
from helpers import printed_equations as printed
from reference import published, tapes

from ibdata.dynamics import VARIANTS
from ibdata.dynamics.state import FIELDS

PART = 1 if FULL else 4  # of the steps
TAPES = {  # setpoints, drifting, steps, seed; every setpoint is run with each of four styles of actions
    "siemens": [
        ((0, 1, 5, *range(10, 101, 10)), False, 1000 // PART, 4),
        ((0, 2, 2, 10, 25, 50, 50, 50, 75, 98, 98, 100), True, 1000 // PART, 2),
    ],
    "paper": [
        ((0, 1, 5, *range(10, 101, 10)), False, 600 // PART, 5),
        ((0, 2, 25, 50, 50, 75, 98, 100, 2), True, 600 // PART, 6),
        ((0,) * 25, True, 20, 7),  # the only way to stand at 0: as printed, rates b >= 0 are drawn
    ],
}
# From 100, after the flip there, the at most 99 steps left of a segment at b < 1 end above 0.
NEVER = {"siemens": {}, "paper": {"setpoint reaches 0": 0}}


def published_lane(tape, lane):
    p, rows = tape.setpoint[lane], tapes.rows(tape, lane)
    return published.run(p, tape.drifting, tape.action[:, lane], rows)


def printed_lane(tape, lane):
    state, states = printed.start(tape.setpoint[lane].item(), tape.drifting), []
    for action, row in zip(tape.action[:, lane].tolist(), tapes.rows(tape, lane), strict=True):
        state = printed.step(state, action, row)
        states.append(state)
    return {name: np.array([s[name] for s in states]) for name in FIELDS}


@pytest.mark.parametrize(("variant", "number"), [(v, i) for v in TAPES for i in range(len(TAPES[v]))])
def test_every_variable_is_that_of_the_other_implementation(variant, number):
    """All fields of `State`, from the first, zero-action step on, within 1e-12 · max(1, |value|)."""
    tape = tapes.make(*TAPES[variant][number])
    other = published_lane if variant == "siemens" else printed_lane
    lanes = [other(tape, lane) for lane in range(len(tape.setpoint))]
    expected = {name: np.stack([lane[name] for lane in lanes], axis=1) for name in FIELDS}
    table = tapes.differences(tapes.run_ibdata(tape, variant), expected)
    assert {field: x for field, x in table.items() if not x <= tapes.TOLERANCE} == {}


@pytest.mark.parametrize(("variant", "least"), [("siemens", 100_000), ("paper", 50_000)])
def test_the_tapes_are_long_and_take_every_branch(variant, least):
    """A comparison proves nothing about a branch that was not taken: each that can be, often."""
    made = [tapes.make(*options) for options in TAPES[variant]]
    assert sum(map(tapes.transitions, made)) >= least // PART
    total = tapes.total_coverage(made, VARIANTS[variant])
    assert {name: n for name, n in total.items() if n < 10 // PART} == NEVER[variant]
