"""The reference returns are those of the policies, and give the scale of the scores."""

import json
import math

import numpy as np
import pytest
from helpers import ROOT, script

from ibdata import evaluate
from ibdata.dataset.reference_returns import Measured, Scale, reference, scale
from measuring.documents import measured

POLICIES = ["zero", "random", "safe", "mediocre", "optimized", "expert"]
ENDS = ["random", "optimized", "expert"]
SETPOINTS = [5.0 * i for i in range(21)]
BURN_IN = {"burn_in": [15, 64]}
SETTINGS = [
    (dynamics, start, *length)
    for start in ("default", "uniform", BURN_IN)
    for dynamics in ("siemens", "paper")
    for length in ((100, 0.97), (1000, 1.0))
]
settings = pytest.mark.parametrize("settings", SETTINGS)


def block(policy, dynamics="siemens"):
    if policy == "zero":
        return {"kind": "constant", "name": "zero"}
    return {"kind": policy, **({"dynamics": dynamics} if policy == "expert" else {})}


def row(dynamics, start, steps, discount, policy, setpoint):
    results = scale(dynamics, start, steps, discount).results
    return next(r for r in results if (r.policy, r.setpoint) == (policy, setpoint))


@settings
def test_every_policy_has_a_return_at_every_setpoint(settings):
    """All six from the default start, and those that define the scores from the others."""
    results, default = scale(*settings).results, settings[1] == "default"
    found = [(r.policy, r.setpoint) for r in results]
    assert found == [(policy, p) for policy in (POLICIES if default else ENDS) for p in SETPOINTS]
    for r in results:
        low, high = r.interval
        assert low < r.mean_return < high
        assert 0.0 < r.standard_error < (0.01 if default else 0.02) * abs(r.mean_return)
        assert r.mean_return < r.mean_reward < 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dynamics", "start", "steps", "discount", "policy", "setpoint"),
    [
        ("siemens", "default", 100, 0.97, "optimized", 70.0),
        ("paper", "default", 1000, 1.0, "expert", 85.0),
        ("siemens", BURN_IN, 1000, 1.0, "expert", 50.0),
        ("siemens", "uniform", 1000, 1.0, "optimized", 5.0),
    ],
)
def test_the_file_is_as_measured(dynamics, start, steps, discount, policy, setpoint):
    stored = row(dynamics, start, steps, discount, policy, setpoint)
    episodes = scale(dynamics, start, steps, discount).episodes
    options = {"start": start, "dynamics": dynamics, "steps": steps, "discount": discount}
    [found] = evaluate(block(policy, dynamics), setpoint, episodes=episodes, **options).results
    for name in ("mean_return", "standard_error", "p10", "mean_reward", "interval"):
        assert getattr(found, name) == pytest.approx(getattr(stored, name), rel=1e-9)


@pytest.mark.parametrize("policy", POLICIES)
def test_other_random_numbers_give_the_same_returns(policy):
    """Within 5 standard errors of both; a return that is wrong by 10 of them (below 2 %) would show."""
    for setpoint in (0.0, 100.0):
        stored = row("siemens", "default", 100, 0.97, policy, setpoint)
        [found] = evaluate(block(policy), setpoint, episodes=400, seed=1).results
        error = math.hypot(stored.standard_error, found.standard_error)
        assert found.mean_return == pytest.approx(stored.mean_return, abs=5 * error)


@settings
def test_the_ends_of_every_scale_are_0_and_100(settings):
    """And the expert is better than optimized at every setpoint."""
    made = scale(*settings)
    for setpoint in SETPOINTS:
        rows = [row(*settings, policy, setpoint) for policy in ENDS]
        low, high, best = (r.mean_return for r in rows)
        assert [made.score(setpoint, x) for x in (low, high)] == pytest.approx([0.0, 100.0])
        assert [made.score(setpoint, x, "expert") for x in (low, best)] == pytest.approx([0.0, 100.0])
        assert best - high > 3 * math.hypot(rows[1].standard_error, rows[2].standard_error)
    means = [np.mean([row(*settings, policy, p).mean_return for p in SETPOINTS]) for policy in ENDS]
    assert made.ends(SETPOINTS) == pytest.approx((means[0], means[1]))
    assert made.ends(SETPOINTS, "expert") == pytest.approx((means[0], means[2]))
    assert made.ends([70.0, 71.0]) is None


def test_the_page_shows_the_rewards_of_the_file():
    made = script("reference-returns")
    page = (ROOT / "docs/evaluation.md").read_text(encoding="utf-8")
    scales = json.loads(made.FILE.read_text(encoding="utf-8"))["scales"]
    assert measured(page).strip() == made.rewards(scales)
    assert reference().made_by == "studies/reference-returns"


def made_up(low, high, error):
    rows = [
        Measured(policy, p, x, error, [x - error, x + error], x, x)
        for p in (60.0, 70.0)
        for policy, x in (("random", low), ("optimized", high))
    ]
    return Scale.model_construct(results=rows)


def test_a_score_needs_ends_that_are_five_standard_errors_apart():
    # √(3² + 3²) · 5 = 21.2
    assert made_up(-120.0, -98.0, 3.0).score(70.0, -109.0) == 50.0
    assert made_up(-120.0, -99.0, 3.0).score(70.0, -109.0) is None
    assert made_up(-98.0, -120.0, 0.1).score(70.0, -109.0) is None
    assert made_up(-120.0, -98.0, 3.0).score(71.0, -109.0) is None
    # the mean of two has 1/√2 of the error: 15
    assert made_up(-120.0, -104.5, 3.0).ends([60.0, 70.0]) == (-120.0, -104.5)
    assert made_up(-120.0, -105.5, 3.0).ends([60.0, 70.0]) is None


@pytest.mark.parametrize(
    "settings",
    [
        ("siemens", {"burn_in": [1, 2]}, 100, 0.97),
        ("siemens", "default", 100, 1.0),
        ({"base": "siemens"}, "default", 100, 0.97),
    ],
)
def test_only_equal_things_are_compared(settings):
    assert scale(*settings) is None
