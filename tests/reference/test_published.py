"""The `siemens` variant against the authors' published package, on one tape of random numbers."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import published, tapes

from ibdata.dynamics import SIEMENS
from ibdata.dynamics.state import FIELDS

TAPES = {  # name: setpoints, drifting, steps, seed
    "constant": ((0, 1, 5, *range(10, 101, 10)), False, 1000, 1),
    "drifting": ((0, 2, 2, 10, 25, 50, 50, 50, 75, 98, 98, 100), True, 1000, 2),
}


def published_states(tape):
    """The published package's states, stacked as ibdata's: (steps, n, ...)."""
    lanes = [
        published.run(p, tape.drifting, tape.action[:, lane], tapes.rows(tape, lane))
        for lane, p in enumerate(tape.setpoint)
    ]
    return {name: np.stack([lane[name] for lane in lanes], axis=1) for name in FIELDS}


@pytest.mark.parametrize("name", TAPES)
def test_every_variable_is_that_of_the_published_package(name, report):
    """All fields of `State`, from the first, zero-action step on, within 1e-12 · max(1, |value|)."""
    tape = tapes.make(*TAPES[name])
    ours = tapes.run_ibdata(tape, "siemens")
    table = tapes.differences(ours, published_states(tape))
    report(f"siemens {name}", tapes.transitions(tape), table)
    assert {field: x for field, x in table.items() if not x <= tapes.TOLERANCE} == {}


def test_the_tapes_hold_at_least_100_000_transitions():
    """Every setpoint is run with each of four styles of actions; the zero-action step is not counted."""
    assert sum(tapes.transitions(tapes.make(*made)) for made in TAPES.values()) >= 100_000


def test_the_tapes_take_every_branch():
    """A comparison proves nothing about a branch that was not taken: each one, at least ten times."""
    total = tapes.total_coverage([tapes.make(*made) for made in TAPES.values()], SIEMENS)
    assert {name: n for name, n in total.items() if n < 10} == {}


def test_the_draws_of_numpy_are_restored_after_a_run():
    """Also `np.float`, which current numpy does not have."""
    before = {name: getattr(np.random, name) for name in published.DRAWS}
    tape = tapes.make([50], False, 5, 3)
    published.run(50, False, tape.action[:, 0], tapes.rows(tape, 0))
    assert {name: getattr(np.random, name) for name in published.DRAWS} == before
    assert "float" not in vars(np)


def fail_within(context):
    with context:
        raise ZeroDivisionError


def test_the_draws_of_numpy_are_restored_after_a_failure():
    """An error while they are replaced leaves nothing behind."""
    before = {name: getattr(np.random, name) for name in published.DRAWS}
    with published.replaced_draws():
        during = {name: getattr(np.random, name) for name in published.DRAWS}
    assert all(during[name] != before[name] for name in published.DRAWS)
    with pytest.raises(ZeroDivisionError):
        fail_within(published.replaced_draws())
    assert {name: getattr(np.random, name) for name in published.DRAWS} == before
    assert "float" not in vars(np)


def test_a_draw_more_than_given_is_an_error():
    """The reader cannot pass over a call that the published code makes and the tape does not foresee."""
    tape = tapes.make([50], False, 0, 4)
    with published.replaced_draws() as reader:
        reader.load(tapes.rows(tape, 0)[0])
        reader.randn()
        with pytest.raises(IndexError):
            reader.randn()
        with pytest.raises(AssertionError):
            reader.check_all_read()
