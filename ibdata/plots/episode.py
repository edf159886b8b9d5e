"""The picture of one episode, with observed variables above and hidden ones below."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ibdata.plots.style import BLACK, BLUE, GREEN, ORANGE, PURPLE, RED, pixels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE = (9.0, 6.0)
SHORTEST = 50  # least length of the axis in steps, so that it does not change at every step
PANELS: tuple[tuple[str, tuple[tuple[str, str, str, str], ...]], ...] = (
    (
        "observed:\nsteerings",
        (
            ("velocity", "velocity", BLUE, "-"),
            ("gain", "gain", ORANGE, "--"),
            ("shift", "shift", GREEN, "-."),
            ("setpoint", "setpoint", BLACK, ":"),
        ),
    ),
    (
        "observed:\ncost",
        (("consumption", "consumption", RED, "-"), ("fatigue", "fatigue", PURPLE, "--")),
    ),
    ("hidden:\nfatigue's μ", (("mu_v", "μᵛ", BLUE, "-"), ("mu_g", "μᵍ", ORANGE, "--"))),
    ("hidden:\ndirection φ", (("direction", "φ", GREEN, "-"),)),
)
PLOTTED = [name for _, lines in PANELS for name, *_ in lines]
# By the first variable of a panel.
LIMITS = {"velocity": (-5.0, 105.0), "mu_v": (-0.25, 5.25), "direction": (-6.5, 6.5)}


def draw_episode(figure: Figure, steps: Mapping[str, Any]) -> None:
    """Draw variables of the state, by name and with a value per step, in those panels that have data."""
    panels = [panel for panel in PANELS if panel[1][0][0] in steps]
    axes = figure.subplots(len(panels), 1, sharex=True)
    for axis, (title, lines) in zip(axes, panels, strict=True):
        for name, label, color, style in lines:
            axis.plot(np.asarray(steps[name]), style, color=color, label=label)
        axis.set_ylabel(title)
        axis.set_ylim(LIMITS.get(lines[0][0]))
        if lines[0][0] == "direction":
            axis.set_yticks([-6, 0, 6])
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))  # where it hides nothing
    axes[-1].set_xlabel("step t")
    axes[-1].set_xlim(0, max(SHORTEST, len(steps["setpoint"]) - 1))


def frame(steps: Mapping[str, Any]) -> npt.NDArray[np.uint8]:
    """Draw the episode so far as bytes (600, 900, 3)."""
    return pixels(lambda figure: draw_episode(figure, steps), SIZE)
