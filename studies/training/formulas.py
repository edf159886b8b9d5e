"""Published formulas over ten setpoints, beside ours, in many paired episodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

import ibdata
from measuring.documents import table
from training.protocol import AT_TEN
from training.results import number

Floats = npt.NDArray[np.float64]
EPISODES = 2000  # at each setpoint
FRAMES = 6
# Of setpoint, velocity, gain, shift, fatigue and consumption, as the policy `optimized` has them.
MEAN = np.array([55.0, 48.75, 50.53, 49.45, 37.51, 166.33])
STD = np.array([28.72, 12.31, 29.91, 29.22, 31.17, 139.44])
P, V, G, H, F = range(5)
Past = Callable[[int, int], Floats]  # a standardised variable so many steps ago
# Returns in hundreds, by the formula's complexity; how many episodes they are of is not said.
PUBLISHED = {"random": -68.09, "constant": -60.78, "21": -52.78, "27": -52.68, "29": -52.32}


class Formula:
    """A policy that computes its actions from standardised observations."""

    def __init__(self, actions: Callable[[Past], tuple[Floats, Floats, Floats]]) -> None:
        self.actions = actions

    def predict(self, observations: npt.NDArray[np.float32]) -> Floats:
        """Actions (n, 3) for observations (n, 6 · FRAMES), newest first."""
        z = (observations.reshape(-1, FRAMES, 6) - MEAN) / STD
        return np.clip(np.stack(self.actions(lambda variable, ago: z[:, ago, variable]), axis=1), -1.0, 1.0)


def complexity_27(z: Past) -> tuple[Floats, Floats, Floats]:
    """The formula of complexity 27."""
    return (
        -z(V, 4) - 0.96,
        0.4 * z(F, 1) + z(F, 4) - 0.6 * z(P, 0) + 0.76,
        -z(H, 3) - 1.57 * z(H, 4) + z(P, 0) + 0.52,
    )


def complexity_29(z: Past) -> tuple[Floats, Floats, Floats]:
    """The formula of complexity 29."""
    return (
        -z(V, 4) - 0.96,
        0.41 * z(F, 1) + z(F, 4) - 0.59 * z(P, 0) + 0.77,
        -4.05 * z(H, 3) - z(H, 4) + 2.26 * z(P, 0) + 0.90,
    )


POLICIES: dict[str, Any] = {
    "random": "random",
    "constant": {"kind": "constant"},
    "21": "optimized",
    "27": Formula(complexity_27),
    "29": Formula(complexity_29),
    "expert": "expert",
}


def measure(episodes: int = EPISODES) -> list[dict[str, Any]]:
    """The mean returns over ten setpoints, and those less that of `optimized`, with standard errors."""
    history = {"27": FRAMES, "29": FRAMES}
    evaluation = ibdata.evaluate(POLICIES, history=history, **{**AT_TEN, "episodes": episodes})
    rows = []
    for result in evaluation.results:
        if result.setpoint is None:
            row = {"policy": result.policy, "return": result.mean_return, "error": result.standard_error}
            rows.append({**row, **less_optimized(evaluation, result.policy)})
    return rows


def less_optimized(evaluation: ibdata.Evaluation, policy: str) -> dict[str, float]:
    """The paired difference of a policy from `optimized`."""
    for each in evaluation.differences:
        if each.setpoint is None and {each.policy, each.minus} == {policy, "21"}:
            sign = 1.0 if each.policy == policy else -1.0
            return {"difference": sign * each.mean_difference, "difference_error": each.standard_error or 0.0}
    return {"difference": 0.0, "difference_error": 0.0}


def table_of(rows: list[dict[str, Any]]) -> str:
    """A Markdown table of the returns in hundreds."""
    cells = []
    for row in rows:
        name = row["policy"]
        label = f"complexity {name}" if name.isdigit() else name
        published = number(PUBLISHED[name], 2) if name in PUBLISHED else "–"
        own = f"{number(row['return'] / 100, 3)} ± {row['error'] / 100:.3f}"
        paired = f"{number(row['difference'] / 100, 3)} ± {row['difference_error'] / 100:.3f}"
        cells.append([label, published, own, paired])
    return table(["policy", "published", "ours", "ours − complexity 21, paired"], cells)
