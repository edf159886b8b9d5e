"""Four moving setpoints, which begin at 50.

Hein et al. 2017, Fig. 5.
"""

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from ibdata.plots.style import BLACK, BLUE, GREEN, ORANGE
from paper.episodes import episodes

SEED = 0
STEPS = 1000
LINES = ((BLUE, "-"), (ORANGE, "--"), (GREEN, "-."), (BLACK, ":"))


def paths() -> npt.NDArray[np.float64]:
    """The setpoints (4, 1000)."""
    episodes_drawn = episodes("drifting", "constant", STEPS, SEED, len(LINES))
    return np.array([columns["setpoint"] for columns in episodes_drawn])


def draw(figure: Figure) -> None:
    """Draw the setpoints over the steps."""
    figure.set_size_inches(6.5, 2.6)
    axes = figure.subplots()
    for number, (path, (color, style)) in enumerate(zip(paths(), LINES, strict=True)):
        axes.plot(path, style, color=color, label=f"episode {number}")
    axes.set_xlabel("step t")
    axes.set_ylabel("setpoint p")
    axes.set_xlim(0, STEPS - 1)
    axes.set_ylim(-3, 103)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    axes.set_title(f"variant siemens, seed {SEED}")
