"""Fatigue, operational cost, consumption and reward of 200 random steps.

Hein et al. 2017, Fig. 4: uniform random actions. The episode is the one that `ibdata generate --config
random.yaml` makes at setpoint 50 with the same seed.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ibdata.dynamics import SIEMENS
from ibdata.dynamics.consumption import FATIGUE_WEIGHT, PENALTY_WEIGHT, operational_cost
from ibdata.plots.style import BLACK, BLUE, GREEN, ORANGE, PURPLE, RED, SKY
from ibdata.views.variables import AMPLIFICATION_START
from paper.episodes import Columns, episodes

SEED = 161  # μᵍ runs away at t = 82 and α changes at the cap of μ, at 96; in the paper at 90 and 100
STEPS = 200
SETPOINT = 50.0
OFFSET = SIEMENS.consumption_offset


def parts() -> Columns:
    """The quantities drawn, by name, (200,) at steps 0 … 199."""
    (state,) = episodes(SETPOINT, "random", STEPS, SEED)
    steerings = zip(state["setpoint"], state["velocity"], state["gain"], strict=True)
    return {
        "mu_g": state["mu_g"],
        "mu_v": state["mu_v"],
        "fatigue": state["fatigue"],
        "theta": np.array([operational_cost(p, v, g) for p, v, g in steerings]),
        "convolved_cost": state["convolved_cost"],
        "miscalibration": PENALTY_WEIGHT * (state["penalty"] + OFFSET),
        "expected_consumption": state["expected_consumption"],
        "consumption": state["consumption"],
        "weighted_fatigue": FATIGUE_WEIGHT * state["fatigue"],
        "cost": state["consumption"] + FATIGUE_WEIGHT * state["fatigue"],
    }


def draw(figure: Figure) -> None:
    """Draw four panels over the same steps."""
    figure.set_size_inches(9.0, 5.6)
    x = parts()
    panels = figure.subplot_mosaic("ab\nab\nmb\ncd\ncd\ncd", sharex=True)
    a, mu, b, c, d = (panels[name] for name in "ambcd")
    _fatigue(a, mu, x)
    b.plot(x["theta"], color=SKY, label="θ: operational cost")
    b.plot(x["convolved_cost"], "--", color=BLUE, label="θᶜ: delayed and blurred")
    b.set_title("(b) operational cost")
    c.plot(x["consumption"], color=PURPLE, label="c: consumption, with noise")
    c.plot(x["convolved_cost"], "--", color=BLUE, label="θᶜ")
    c.plot(x["miscalibration"], "-.", color=GREEN, label=f"25 (m + {OFFSET:g})")
    c.set_title("(c) consumption = θᶜ + mis-calibration + noise")
    steps = np.arange(STEPS)
    d.fill_between(steps, 0.0, x["consumption"], color=PURPLE, alpha=0.55, linewidth=0, label="c")
    d.fill_between(
        steps, x["consumption"], x["cost"], color=ORANGE, alpha=0.8, linewidth=0, hatch="///", label="3 f"
    )
    d.plot(x["cost"], color=BLACK, linewidth=0.9, label="−r = c + 3 f")
    d.set_title("(d) negative reward, and its parts")
    for axes in (b, c, d):
        axes.set_ylabel("cost units")
        axes.set_ylim(min(0.0, axes.get_ylim()[0]), axes.get_ylim()[1] * 1.25)
        axes.legend(loc="upper left", ncols=3, fontsize=7.5, columnspacing=1.0)
    for axes in (c, d):
        axes.set_xlabel("step t")
        axes.set_xlim(0, STEPS - 1)
    figure.suptitle(f"uniform random actions, setpoint {SETPOINT:g}, variant siemens, seed {SEED}", size=9)


def _fatigue(upper: Axes, lower: Axes, x: Columns) -> None:
    """Draw fatigue and, below it, the hidden μ that amplify it."""
    upper.plot(x["fatigue"], color=RED, label="f: fatigue")
    upper.set_ylabel("cost units")
    upper.set_title("(a) fatigue, and the hidden μ behind it")
    upper.set_ylim(0, upper.get_ylim()[1] * 1.25)
    lower.plot(x["mu_g"], "--", color=BLUE, label="μᵍ")
    lower.plot(x["mu_v"], ":", color=GREEN, label="μᵛ")
    lower.axhline(
        AMPLIFICATION_START, color=BLACK, linewidth=0.6, linestyle=(0, (8, 4)),
        label=f"run-away from {AMPLIFICATION_START:g}",
    )  # fmt: skip
    lower.set_ylabel("μ")
    lower.set_ylim(0, 8.5)
    lower.set_yticks([0, 5])
    upper.legend(loc="upper left", fontsize=7.5)
    lower.legend(loc="upper left", ncols=3, fontsize=7.5, columnspacing=1.0)
