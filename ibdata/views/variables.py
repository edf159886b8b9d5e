"""The table of variables: every number of a simulated state, listed once.

The table defines the rows of `State`, the ranges that `step` checks, and the columns of a dataset with their
order, units and bounds. To add a variable, add a line here and compute it in `dynamics/step.py`.
"""

from __future__ import annotations

from typing import NamedTuple

AMPLIFICATION_START = 1.2  # of a μ, from which it grows by itself, Eq. (23) of Hein et al. (2017)
COST_MAX = 4915  # θ <= e^8.5 ≈ 4914.8
M_MIN, M_MAX = -1.001, 1.24  # of the penalty m


class Variable(NamedTuple):
    """One number of the state of an episode.

    The role says where a dataset stores it: "observation", "reward", "latent" (the hidden part of the Markov
    state), "drift" (hidden too, of moving setpoints only), "derived" (computed from others), or "unsaved".
    """

    name: str
    symbol: str
    unit: str  # "1", "cost", "1/step" or "steps"
    low: float | None  # None: unbounded
    high: float | None
    role: str
    meaning: str
    whole: bool = False  # shown as int64, else as float64


_TABLE = (
    Variable("setpoint", "p", "1", 0, 100, "observation", "setpoint p (no action changes it)"),
    Variable("velocity", "v", "1", 0, 100, "observation", "velocity v"),
    Variable("gain", "g", "1", 0, 100, "observation", "gain g"),
    Variable("shift", "h", "1", 0, 100, "observation", "shift h"),
    Variable("fatigue", "f", "cost", 0, 300, "observation", "fatigue f"),
    Variable("consumption", "c", "cost", None, None, "observation", "consumption c (with its noise)"),
    Variable("reward", "r", "cost", None, None, "reward", "reward -c - 3f of the next observation"),
    Variable("theta_0", "θ[t]", "cost", 0, COST_MAX, "unsaved", "operational cost θ, now"),
    *(
        Variable(
            f"theta_{lag}", f"θ[t-{lag}]", "cost", 0, COST_MAX, "latent",
            f"operational cost θ, {lag} step{'s'[: lag > 1]} ago",
        )
        for lag in range(1, 10)
    ),
    Variable("domain", "δ", "1", -1, 1, "latent", "domain δ of the mis-calibration, -1 or 1", True),
    Variable("response", "ψ", "1", -1, 1, "latent", "response ψ of the mis-calibration, -1 or 1", True),
    Variable(
        "direction", "φ", "1", -6, 6, "latent", "direction φ of the mis-calibration, a whole number", True
    ),
    Variable("mu_v", "μᵛ", "1", 0, 5, "latent", "latent μᵛ of the fatigue (velocity)"),
    Variable("mu_g", "μᵍ", "1", 0, 5, "latent", "latent μᵍ of the fatigue (gain)"),
    Variable("drift_rate", "b", "1/step", -100, 100, "drift", "rate b of the moving setpoint"),
    Variable(
        "drift_left", "l", "steps", -1, None, "drift", "steps left of the moving setpoint's segment", True
    ),
    Variable("convolved_cost", "θᶜ", "cost", 0, COST_MAX, "derived", "convolved operational cost θᶜ"),
    Variable("penalty", "m", "1", M_MIN, M_MAX, "derived", "mis-calibration penalty m"),
    Variable("expected_consumption", "ĉ", "cost", None, None, "derived", "consumption without noise ĉ"),
    Variable("effective_shift", "hᵉ", "1", -1.5, 1.5, "derived", "effective shift hᵉ"),
    Variable("effective_velocity", "vᵉ", "1", 0, 1, "derived", "effective velocity vᵉ"),
    Variable("effective_gain", "gᵉ", "1", 0, 1, "derived", "effective gain gᵉ"),
    Variable("alpha", "α", "1", 0, 1, "derived", "amplification α of the fatigue"),
    Variable("basic_fatigue", "f_b", "cost", 0, 300, "derived", "basic fatigue f_b"),
)  # fmt: skip

VARIABLES = {variable.name: variable for variable in _TABLE}
# The variables in the order of the rows of a `State`: whole numbers come last.
ROWS = tuple(variable.name for variable in sorted(_TABLE, key=lambda variable: variable.whole))
FIRST_WHOLE = sum(not variable.whole for variable in _TABLE)  # the first row of whole numbers


def rows(*names: str) -> tuple[int, ...]:
    """The rows of variables in a `State`.

    >>> rows("setpoint", "velocity", "domain")
    (0, 1, 28)
    """
    return tuple(map(ROWS.index, names))


def of_role(*roles: str) -> tuple[str, ...]:
    """The names of the variables of these roles, in the order of the table.

    >>> of_role("drift")
    ('drift_rate', 'drift_left')
    """
    return tuple(variable.name for variable in _TABLE if variable.role in roles)


def variable_of(column: str) -> str:
    """The variable of a column.

    >>> variable_of("obs_fatigue"), variable_of("latent_theta_1")
    ('fatigue', 'theta_1')
    """
    return column.split("_", 1)[1]
