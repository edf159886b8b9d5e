"""`ibdata.published` against the published package: what scripts see, from the same seeds.

The package does not run on NumPy 2 as it is. So some rows come from a file that it made on NumPy 1.23, and
all from it with `np.float` given back. The actions are float64 there, because NumPy 2 computes in float32
where the actions are float32.
"""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest
from helpers import FULL, ROOT
from reference import old_scripts, tapes

from ibdata import published

STORED = json.loads((ROOT / "tests/reference/old_scripts.json").read_text())["rows"]
# At full size three scripts go on to the last kept row: these meet bounds, moving setpoints and all of a gym.
LONG = ("IDS, fixed at 100, beyond the range of actions", "IDS, drifting from a bound")
LONG += ("IBGym, delta, continuous, include_past",)

pytestmark = pytest.mark.usefixtures("global_generator")


@pytest.fixture
def package(monkeypatch):
    """Both classes, on NumPy 2. `IBGym` imports the package `gym`, which says on stderr that it is old."""
    monkeypatch.setattr(np, "float", float, raising=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from industrial_benchmark_python.IBGym import IBGym
        from industrial_benchmark_python.IDS import IDS

        yield IDS, IBGym


def worst(seen, expected):
    return np.max(np.abs(seen - expected) / np.maximum(1.0, np.abs(expected)))


@pytest.mark.parametrize("name", old_scripts.NAMES)
def test_a_script_sees_the_numbers_that_the_package_gave_it_on_numpy_1_and_gives_it_now(name, package):
    kept = old_scripts.KEPT if FULL and name in LONG else old_scripts.KEPT[:-1]
    steps = kept[-1] + 1
    seen = old_scripts.rows(name, steps, published.IDS, published.IBGym)
    assert worst(seen[list(kept)], np.array(STORED[name][: len(kept)])) <= tapes.TOLERANCE
    seen = old_scripts.rows(name, steps, published.IDS, published.IBGym, kind=np.float64)
    assert worst(seen, old_scripts.rows(name, steps, *package, kind=np.float64)) <= tapes.TOLERANCE


def test_the_scripts_reach_every_draw():
    """The cap of a μ, where α is drawn; several segments of a setpoint; a bound, where it may turn."""
    column = {key: 19 + i for i, key in enumerate(published.STATE_KEYS)}  # after the ten costs
    caps, bounds = [column["hv"], column["hg"]], (0.0, 100.0)
    for name in old_scripts.IDS_SCRIPTS:
        seen = old_scripts.rows(name, 300, published.IDS, published.IBGym)
        assert (seen[:, caps] == 5.0).any(axis=1).sum() > 20
        setpoint = seen[:, column["p"]]
        assert (len(set(np.diff(setpoint).round(9))) > 5) == ("drifting" in name)
    assert ((setpoint[:-1] != setpoint[1:]) & np.isin(setpoint[1:], bounds)).any()
