"""Settings and actions of an environment, its registration, and what is refused, without Gymnasium."""

from __future__ import annotations

import re
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from helpers.refusals import refused
from helpers.variants import VARIANTS_MOVED

from ibdata.dynamics import Noise, initial_state, step
from ibdata.environment.actions import (
    DISCRETE,
    continuous_action,
    continuous_actions,
    discrete_action,
    discrete_actions,
)
from ibdata.environment.settings import consumption_bounds, settings
from ibdata.environment.streams import refuse_negative
from ibdata.errors import UsageError, excerpt

WRONG = {
    "setpoint": {
        101: "found 101, expected a number of at most 100",
        "drift": "found 'drift', expected a number, a list, {start, stop, step} or drifting; "
        "did you mean 'drifting'?",
        (10, 20): "found (10, 20), expected one, or one that moves",
    },
    "dynamics": {"simens": "found 'simens'; did you mean 'siemens'?"},
    "start": {"anywhere": "found 'anywhere', expected one of default, uniform"},
    "history": {
        0: "found 0, expected a whole number of at least 1",
        True: "found True, expected a whole number",
    },
}


@pytest.mark.parametrize(("name", "value"), [(name, value) for name in WRONG for value in WRONG[name]])
def test_a_setting_that_cannot_be_meant_is_named(name, value):
    with pytest.raises(UsageError) as caught:
        settings(**{name: value})
    assert str(caught.value) == f"{name}: {WRONG[name][value]}"


@pytest.mark.parametrize("variant", VARIANTS_MOVED.values(), ids=VARIANTS_MOVED)
def test_the_extremes_of_consumption_are_near_its_bounds(variant):
    """The dearest and the cheapest steerings, the worst and the best of m, the normal draw at its ends."""
    low, high = consumption_bounds(variant)
    seen = []
    for p, v, g, turns in ((100.0, 100.0, 100.0, 40), (0.0, 0.0, 0.0, 5)):
        for z in (-8.2, 8.2):
            state = initial_state(p, v, g, 100.0 if turns == 40 else 50.0)
            noise = Noise(*(np.zeros(1) for _ in Noise._fields))._replace(normal_consumption=np.array([z]))
            for _ in range(turns):
                state = step(state, [[0.0, 0.0, 1.0]], noise, variant)
                seen.append(state.consumption[0])
    assert low <= min(seen)
    assert max(seen) <= high
    assert max(seen) > 0.97 * high
    assert min(seen) < low + 30.0


def test_the_last_of_velocity_gain_and_shift_changes_fastest():
    digits = [tuple(float(x) - 1 for x in np.base_repr(i, 3).zfill(3)) for i in range(27)]
    assert list(DISCRETE) == digits
    for kind in (int, np.uint8, np.array):  # a number of Python's or numpy's
        assert [discrete_action(kind(i)) for i in range(27)] == digits


LISTS = [[0, 1], [0, 1, 27], [0, -1, 2], [0.0, 1.0, 2.0], 3, [True] * 3]
REFUSED = [
    (discrete_action, "a whole number from 0 to 26", [27, -1, 1.0, True, None, [3], np.float32(3)]),
    (partial(discrete_actions, n=3), "3 whole numbers from 0 to 26", LISTS),
    (continuous_action, "three finite numbers", [[0, 0, np.nan], [0, 0], "left", None]),
    (partial(continuous_actions, n=1), "(1, 3) finite numbers", [[[0, 0, np.nan]], [0, 0, 0], "left"]),
]


def test_other_actions_are_refused_in_one_line():
    for convert, expected, wrong in REFUSED:
        for given in wrong:
            refused(re.escape(f"action: found {excerpt(given, 80)}, expected {expected}"), convert, given)


def test_a_negative_seed_and_a_drift_of_a_constant_setpoint_are_refused_in_one_line():
    refuse_negative([None, 0, 2**70])
    refused(r"^seed: found -1, expected a whole number of at least 0$", refuse_negative, [0, None, -1])
    with pytest.raises(UsageError, match="found latent_drift_rate, which only a moving setpoint has"):
        settings(view={"observe": ["latent_drift_rate"]})


# Stands in for Gymnasium, which the core does not install: what ibdata uses of it.
STAND_IN = """
registry = {}
def register(id, **given):
    assert id not in registry
    registry[id] = given
"""
EXPECTED = {
    "ibdata/IndustrialBenchmark-v0": {
        "entry_point": "ibdata.environment:IndustrialBenchmarkEnv",
        "vector_entry_point": "ibdata.environment:IndustrialBenchmarkVectorEnv",
        "max_episode_steps": 1000,
    }
}


INSTALL = "ibdata.environment needs the package gymnasium: pip install gymnasium, or 'ibdata[gymnasium]'"
# It is not there, and importing ibdata leaves no trace.
WITHOUT = """
import sys
class Without:
    def find_spec(self, name, path=None, target=None):
        if name == 'gymnasium':
            raise ModuleNotFoundError(name, name=name)
sys.meta_path.insert(0, Without())
before = list(sys.meta_path)
import ibdata, ibdata.environment
assert sys.meta_path == before
try:
    ibdata.environment.IndustrialBenchmarkEnv
except ImportError as error:
    print(error)
"""


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("import gymnasium, ibdata; print(gymnasium.registry)", str(EXPECTED)),
        ("import ibdata, gymnasium, ibdata.environment; print(gymnasium.registry)", str(EXPECTED)),
        (WITHOUT, INSTALL),
    ],
    ids=["before", "after", "without"],
)
def test_it_is_registered_once_in_every_order_or_says_what_to_install(tmp_path, code, expected):
    (tmp_path / "gymnasium.py").write_text(STAND_IN)
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert (done.stdout.strip(), done.stderr) == (expected, "")
