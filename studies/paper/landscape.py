"""The penalty m of the mis-calibration over direction φ and effective shift hᵉ, and how φ turns.

Hein et al. 2017, Fig. 2. It is the same in both variants and not random.
"""

from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from ibdata.dynamics.miscalibration import HE_MAX, PHI_MAX, SAFE_ZONE, penalty
from ibdata.plots.style import BLACK

ROWS = 301
COLORS = "cividis"  # blue to yellow, for colour-blind readers and for grey prints too
ARROW = {"arrowstyle": "-|>", "color": BLACK, "linewidth": 1.4, "shrinkA": 0, "shrinkB": 0}
BOX = {"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}

Floats = npt.NDArray[np.float64]


def grid() -> tuple[Floats, Floats, Floats]:
    """The directions φ (13,), effective shifts hᵉ (301,) and penalties m (301, 13) there."""
    phi, he = np.arange(-PHI_MAX, PHI_MAX + 1), np.linspace(-HE_MAX, HE_MAX, ROWS)
    m = np.array([[penalty(int(i), float(x)) for i in phi] for x in he])
    return phi.astype(np.float64), he, m


def background(axes: Axes) -> QuadMesh:
    """Draw the penalty as colours, one column per direction, and the safe zone."""
    phi, he, m = grid()
    mesh = axes.pcolormesh(phi, he, m, cmap=COLORS, shading="nearest", vmin=-1.0, vmax=1.24, rasterized=True)
    axes.axhspan(-SAFE_ZONE, SAFE_ZONE, facecolor="white", edgecolor="none", alpha=0.45)
    for edge in (-SAFE_ZONE, SAFE_ZONE):
        axes.axhline(edge, color="white", linewidth=0.8, linestyle="--")
    axes.set_xlim(-PHI_MAX - 0.5, PHI_MAX + 0.5)
    axes.set_ylim(-HE_MAX, HE_MAX)
    axes.set_xticks(range(-PHI_MAX, PHI_MAX + 1, 2))
    axes.set_yticks(np.arange(-HE_MAX, HE_MAX + 0.1, 0.5))
    axes.set_xlabel("direction φ")
    axes.set_ylabel("effective shift hᵉ")
    axes.spines[["top", "right"]].set_visible(True)
    return mesh


def scale(figure: Figure, mesh: QuadMesh, axes: Any) -> None:
    """Draw the scale of the colours."""
    figure.colorbar(mesh, ax=axes, label="penalty m", ticks=[-1.0, -0.5, 0.0, 0.5, 1.0])


def draw(figure: Figure) -> None:
    """Draw the landscape, with arrows for the changes of φ outside and inside the safe zone."""
    figure.set_size_inches(6.5, 4.2)
    axes = figure.subplots()
    scale(figure, background(axes), axes)
    for sign, domain in ((1, "positive domain, δ = 1"), (-1, "negative domain, δ = −1")):
        _arrow(axes, (-5.5 * sign, 0.42 * sign), (5.9 * sign, 0.42 * sign))
        _arrow(axes, (5.5 * sign, 1.28 * sign), (-5.9 * sign, 1.28 * sign))
        _arrow(axes, (-6.0 * sign, 0.0), (-0.6 * sign, 0.0))
        _say(axes, 0.0, 0.85 * sign, domain)
        _say(axes, 0.0, 0.42 * sign, "advantageous, ψ = 1")
        _say(axes, 0.0, 1.28 * sign, "disadvantageous, ψ = −1")
        _say(axes, 5.3 * sign, 0.85 * sign, f"at φ = {'−'[: sign < 0]}6\nψ turns")
        _say(axes, -5.3 * sign, 0.85 * sign, f"at φ = {'−'[: sign > 0]}6\nφ is held")
    _say(axes, 0.0, 0.0, "reset")
    _say(axes, 3.6, 0.0, "safe zone")


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    axes.annotate("", xy=end, xytext=start, arrowprops=ARROW)


def _say(axes: Axes, x: float, y: float, text: str) -> None:
    axes.text(x, y, text, ha="center", va="center", fontsize=7.5, bbox=BOX)
