"""The `paper` variant against a second implementation of the equations, on one tape of random numbers."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import printed_equations as printed
from helpers import tapes

from ibdata.dynamics import PAPER
from ibdata.dynamics.state import FIELDS

TAPES = {  # name: setpoints, drifting, steps, seed
    "constant": ((0, 1, 5, *range(10, 101, 10)), False, 600, 5),
    "drifting": ((0, 2, 25, 50, 50, 75, 98, 100, 2), True, 600, 6),
    "drifting from 0": ((0,) * 25, True, 20, 7),  # the only way to stand at 0, see below
}


def printed_states(tape):
    """The states of the printed equations, stacked as ibdata's: (steps, n, ...)."""
    lanes = []
    for lane, p in enumerate(tape.setpoint.tolist()):
        state, states = printed.start(p, tape.drifting), []
        for action, row in zip(tape.action[:, lane].tolist(), tapes.rows(tape, lane), strict=True):
            state = printed.step(state, action, row)
            states.append(state)
        lanes.append(states)
    return {name: np.array([[s[name] for s in t] for t in zip(*lanes, strict=True)]) for name in FIELDS}


@pytest.mark.parametrize("name", TAPES)
def test_every_variable_follows_the_printed_equations(name, report):
    """All fields of `State`, from the first, zero-action step on, within 1e-12 · max(1, |value|)."""
    tape = tapes.make(*TAPES[name])
    ours = tapes.run_ibdata(tape, "paper")
    table = tapes.differences(ours, printed_states(tape))
    report(f"paper {name}", tapes.transitions(tape), table)
    assert {field: x for field, x in table.items() if not x <= tapes.TOLERANCE} == {}


def test_the_tapes_hold_at_least_50_000_transitions():
    """Every setpoint is run with each of four styles of actions; the zero-action step is not counted."""
    assert sum(tapes.transitions(tapes.make(*made)) for made in TAPES.values()) >= 50_000


def test_the_tapes_take_every_branch_that_can_be_taken():
    """Each branch at least ten times. As printed, rates b >= 0 are drawn: no setpoint comes down to 0.

    From 100, after the flip there, the at most 99 steps left of a segment at b < 1 end above 0.
    """
    total = tapes.total_coverage([tapes.make(*made) for made in TAPES.values()], PAPER)
    assert {name: n for name, n in total.items() if n < 10} == {"setpoint reaches 0": 0}


def test_the_constants_are_the_ones_printed():
    """Appendix B prints four digits of each; those of α, β and κ are cut, not rounded."""
    constants = (printed.EPSILON, printed.ZETA, printed.LAMBDA, printed.ALPHA, printed.BETA, printed.KAPPA)
    printed_digits = (0.7745, 1.2048, 3.4193, 0.5849, 0.2924, -0.6367)
    assert np.allclose(constants, printed_digits, rtol=0, atol=1e-4)
