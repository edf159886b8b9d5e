"""The picture of a running episode shows what is seen and what is hidden."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from ibdata.plots.episode import PANELS, draw_episode
from paper.episodes import episodes

pytestmark = pytest.mark.slow


def seen(steps):
    return episodes(70.0, "random", steps, 0)[0]


def test_the_panels_draw_what_is_seen_and_what_is_hidden():
    steps = seen(80)
    figure = Figure()
    draw_episode(figure, steps)
    for axes, (_, variables) in zip(figure.axes, PANELS, strict=True):
        assert len(axes.get_lines()) == len(variables)
        for line, (name, label, *_) in zip(axes.get_lines(), variables, strict=True):
            assert line.get_label() == label
            assert np.array_equal(line.get_ydata(), steps[name])
    assert figure.axes[-1].get_xlim() == (0, 79)
