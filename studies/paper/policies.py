"""Three policies of the shift in the landscape of the mis-calibration: optimal, suboptimal, bad.

Hein et al. 2017, Fig. 3. It is the same in both variants and not random.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from ibdata.dynamics import Noise, initial_state, step
from ibdata.dynamics.setpoint import D_H
from ibdata.plots.style import RED
from paper.landscape import BOX, background, scale

SETPOINT = 50.0  # where the initial shift, 50, is in the middle of the safe zone
TURN = 24  # steps of a full turn of φ through both domains
OUT, STAY = 6, 14  # steps of the bad policy: to the best penalty, hᵉ = 1 at φ = 6, and at hᵉ = 1
SINE = np.sin(np.pi * np.arange(TURN + 1) / 12)

Floats = npt.NDArray[np.float64]

# Changes Δh of the shift, one per step.
POLICIES: dict[str, Floats] = {
    "(a) optimal: hᵉ = sin(πt/12)": np.diff(SINE) * 20.0 / D_H,
    "(b) suboptimal: back after six steps": np.array([1.0] * 3 + [-1.0] * 3 + [0.0] * 4),
    "(c) bad: out to hᵉ = 1, and stay": np.repeat([20.0 / D_H / OUT, 0.0], [OUT, STAY]),
}
REPEATED = (TURN, 10, 1)  # last steps of each policy, which repeat
# Steps that are labelled in each panel, with the label's offset in points to the right and up.
MARKED: tuple[dict[int, tuple[int, int]], ...] = (
    {6: (-6, 12), 18: (8, -12), 24: (18, -14)},
    {3: (0, 12), 6: (6, -14), 10: (-16, -14)},
    {6: (-6, 12), 18: (14, -14), 0: (-16, -14)},
)


class Path(NamedTuple):
    """Direction φ, effective shift hᵉ and penalty m (steps + 1,), from the first observation on."""

    phi: Floats
    he: Floats
    m: Floats


def path(delta_h: Floats) -> Path:
    """The path of the changes Δh (steps,) from the default start."""
    silent = Noise(*(np.zeros(1) for _ in Noise._fields))
    state = step(initial_state(SETPOINT), np.zeros((1, 3)), silent)
    rows = [state]
    for change in delta_h:
        state = step(state, [[0.0, 0.0, change]], silent)
        rows.append(state)
    return Path(
        np.array([row.direction[0] for row in rows], dtype=np.float64),
        np.array([row.effective_shift[0] for row in rows]),
        np.array([row.penalty[0] for row in rows]),
    )


def draw(figure: Figure) -> None:
    """Draw the three policies side by side; t counts the steps."""
    figure.set_size_inches(9.0, 3.1)
    panels = figure.subplots(1, len(POLICIES), sharey=True)
    outline = [withStroke(linewidth=2.6, foreground="white")]
    policies = zip(panels, POLICIES.items(), MARKED, REPEATED, strict=True)
    for axes, (title, delta_h), marked, last in policies:
        mesh = background(axes)
        phi, he, m = path(delta_h)
        axes.plot(phi, he, "-o", color=RED, markersize=3.5, path_effects=outline, clip_on=False)
        axes.plot(phi[:1], he[:1], "o", color="white", markeredgecolor=RED, markersize=6, zorder=3)
        for t, (right, up) in marked.items():
            axes.annotate(
                f"t = {t}", (phi[t], he[t]), (right, up), textcoords="offset points",
                ha="center", va="center", fontsize=7.5, bbox=BOX,
            )  # fmt: skip
        axes.set_title(f"{title}\nmean m in the long run: {m[-last:].mean():.2f}".replace("-", "−"))
    for axes in panels[1:]:
        axes.set_ylabel("")
    scale(figure, mesh, panels)
