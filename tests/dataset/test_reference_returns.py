"""The reference returns are those of the policies, and give the scale of the scores."""

import json
import math

import numpy as np
import pytest
from helpers import ROOT, script

from ibdata import evaluate
from ibdata.dataset.reference_returns import Measured, Scale, reference, scale
from measuring.documents import measured

STUDY = script("reference-returns")
ENDS = ["random", "optimized", "expert"]
SETPOINTS = [5.0 * i for i in range(21)]
BURN_IN = {"burn_in": [15, 64]}
FIRST_VALUES = [10.0, 30.0, 50.0, 70.0, 90.0]
LENGTHS = [{"steps": 100, "discount": 0.97}, {"steps": 1000, "discount": 1.0}]
SETTINGS = [
    {"dynamics": dynamics, "start": start, **length}
    for start in ("default", "uniform", BURN_IN)
    for dynamics in ("siemens", "paper")
    for length in LENGTHS
]
APART = {"dynamics": "siemens", "start": "default", "steps": 250, "discount": 1.0}
MOVING = [
    {"dynamics": dynamics, "start": "default", **length, "drifting": True}
    for dynamics in ("siemens", "paper")
    for length in LENGTHS
]
SETTINGS += [APART, *MOVING]
settings = pytest.mark.parametrize("settings", SETTINGS)


def block(policy, dynamics="siemens"):
    return {"kind": policy, **({"dynamics": dynamics} if policy == "expert" else {})}


def row(settings, policy, setpoint):
    return next(r for r in scale(**settings).results if (r.policy, r.setpoint) == (policy, setpoint))


def played(settings, policy, setpoint, **options):
    """The result of an evaluation with the settings of a scale."""
    options |= {name: value for name, value in settings.items() if name != "drifting"}
    setpoint = {"drifting": setpoint} if "drifting" in settings else setpoint
    return evaluate(block(policy, settings["dynamics"]), setpoint, **options).results[0]


def test_the_file_has_these_scales_and_no_others():
    stored = [{name: getattr(s, name) for name in ("dynamics", "start", "steps", "discount", "drifting")}
              for s in reference().scales]  # fmt: skip
    assert stored == [{"drifting": False, **settings} for settings in SETTINGS]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "policy", "setpoint"),
    [
        (SETTINGS[0], "optimized", 70.0),
        ({**SETTINGS[1], "start": BURN_IN}, "expert", 50.0),
        (MOVING[3], "expert", 90.0),
    ],
)
def test_the_file_is_as_measured(settings, policy, setpoint):
    stored = row(settings, policy, setpoint)
    again = played(settings, policy, setpoint, episodes=scale(**settings).episodes)
    for name in ("mean_return", "standard_error", "p10", "mean_reward", "interval"):
        assert getattr(again, name) == pytest.approx(getattr(stored, name), rel=1e-9)


@settings
def test_the_ends_of_every_scale_are_0_and_100(settings):
    """And the expert is better than optimized at every setpoint."""
    made, setpoints = scale(**settings), FIRST_VALUES if "drifting" in settings else SETPOINTS
    for setpoint in setpoints:
        rows = [row(settings, policy, setpoint) for policy in ENDS]
        low, high, best = (r.mean_return for r in rows)
        assert [made.score(setpoint, x) for x in (low, high)] == pytest.approx([0.0, 100.0])
        assert [made.score(setpoint, x, "expert") for x in (low, best)] == pytest.approx([0.0, 100.0])
        assert best - high > 3 * math.hypot(rows[1].standard_error, rows[2].standard_error)
    means = [np.mean([row(settings, policy, p).mean_return for p in setpoints]) for policy in ENDS]
    assert made.ends(setpoints) == pytest.approx((means[0], means[1]))
    assert made.ends(setpoints, "expert") == pytest.approx((means[0], means[2]))
    assert made.ends([70.0, 71.0]) is None


def stored_scales():
    return json.loads(STUDY.FILE.read_text(encoding="utf-8"))["scales"]


def test_the_pages_show_the_returns_of_the_file():
    evaluation, setpoints = (
        (ROOT / f"docs/{page}.md").read_text(encoding="utf-8") for page in ("evaluation", "setpoints")
    )
    assert measured(evaluation).strip() == STUDY.rewards(stored_scales())
    assert measured(setpoints, "measured, apart").strip() == STUDY.apart(stored_scales())
    assert reference().made_by == "studies/reference-returns"


def moving_rows(table):
    """The means and errors of a table of moving setpoints, by dynamics and policy."""
    rows = [line.strip("| ").replace("−", "-").replace("`", "").split(" | ") for line in table.splitlines()]
    return {(d, policy): [tuple(map(float, x.split(" ± "))) for x in means] for d, policy, *means in rows[2:]}


def moving_page():
    text = (ROOT / "docs/setpoints.md").read_text(encoding="utf-8")
    return text, moving_rows(measured(text, "measured, moving").strip())


@pytest.mark.parametrize(
    ("episodes", "seed", "errors"), [(60, 1, 5.0), pytest.param(1000, 0, 0.0, marks=pytest.mark.slow)]
)
def test_the_page_shows_the_rewards_of_moving_setpoints(episodes, seed, errors):
    """The last column within 5 standard errors for other random numbers; 9 % more or less would show."""
    _, page = moving_page()
    again = moving_rows(STUDY.moving(stored_scales(), episodes, seed))
    assert list(page) == list(again)
    for (*shown, (mean, error)), (*made, (other, other_error)) in zip(
        page.values(), again.values(), strict=True
    ):
        assert shown == made
        allowed = errors * math.hypot(error, other_error)
        assert abs(mean - other) <= allowed
        assert 2 * allowed < 0.09 * abs(mean)


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


def test_only_equal_things_are_compared():
    for changes in (
        {"start": {"burn_in": [1, 2]}},
        {"discount": 1.0},
        {"dynamics": {"base": "siemens"}},
        {"start": "uniform", "drifting": True},
        {"steps": 250, "discount": 1.0, "drifting": True},
    ):
        assert scale(**{**SETTINGS[0], **changes}) is None


def test_moving_setpoints_and_constant_ones_are_told_apart():
    still, moving = scale(**SETTINGS[0]), scale(**MOVING[0])
    assert [s.drifting for s in (still, moving)] == [False, True]
    assert moving.text == still.text.replace("same setpoint", "same first value of the moving setpoint")
    assert moving.score(75.0, -7000.0) is None
    assert moving.score(70.0, -7000.0) != still.score(70.0, -7000.0)


def test_a_scale_without_one_of_the_ends_has_no_score():
    known = scale(**SETTINGS[0])
    assert known.ends([10.0, 70.0]) is not None
    assert known.ends([10.0, 70.0], "mediocre") is None  # of which there are no returns
    assert known.ends([10.0, 33.0]) is None
