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

PART = 1 if FULL else 2  # of the steps
TAPES = {  # setpoints, drifting, steps, seed; every setpoint is run with each of four styles of actions
    "siemens": [
        ((0, 1, 5, *range(10, 101, 10)), False, 1000 // PART, 1),
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


def test_the_constants_are_the_ones_printed():
    """Appendix B prints four digits of each; those of α, β and κ are cut, not rounded."""
    constants = (printed.EPSILON, printed.ZETA, printed.LAMBDA, printed.ALPHA, printed.BETA, printed.KAPPA)
    printed_digits = (0.7745, 1.2048, 3.4193, 0.5849, 0.2924, -0.6367)
    assert np.allclose(constants, printed_digits, rtol=0, atol=1e-4)


def failing():
    with published.replaced_draws():
        raise ZeroDivisionError


def test_the_draws_of_numpy_are_restored():
    """After a run, and after an error while they are replaced; so is `np.float`, which numpy has no more."""
    before = {name: getattr(np.random, name) for name in published.DRAWS}
    tape = tapes.make([50], False, 5, 3)
    published_lane(tape, 0)
    with pytest.raises(ZeroDivisionError):
        failing()
    assert {name: getattr(np.random, name) for name in published.DRAWS} == before
    assert "float" not in vars(np)


def test_a_draw_more_or_less_than_given_is_an_error():
    """The reader cannot pass over a call that the published code makes and the tape does not foresee."""
    tape = tapes.make([50], False, 0, 4)
    with published.replaced_draws() as reader:
        reader.load(tapes.rows(tape, 0)[0])
        reader.randn()
        with pytest.raises(IndexError):
            reader.randn()
        with pytest.raises(AssertionError):
            reader.check_all_read()
