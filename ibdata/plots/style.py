"""The style and the rendering of pictures, which use no window or global state and give the same bytes."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._system import processes
from ibdata._system.imports import without_file
from ibdata.errors import IbdataError, missing

try:
    # In a session, matplotlib is the user's too.
    with without_file("matplotlibrc") if processes.purpose != "session" else nullcontext():
        import matplotlib
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter
except ModuleNotFoundError:
    raise missing("ibdata.plots", "matplotlib", "plot") from None
except Exception as error:  # whatever a user's own matplotlibrc leads to
    raise IbdataError(f"matplotlib: cannot be imported: {error}; correct your matplotlibrc") from None

# Okabe and Ito's colours, which colour-blind readers can distinguish; lines also differ in style.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, RED, PURPLE = "#0072B2", "#D55E00", "#CC79A7"
SERIES = (  # colour, marker, line
    (BLUE, "o", "-"),
    (ORANGE, "s", "--"),
    (GREEN, "^", "-."),
    (RED, "D", ":"),
    (PURPLE, "v", (0, (5, 1))),
    (SKY, "P", (0, (3, 1, 1, 1))),
    (BLACK, "X", (0, (1, 3))),
)
SETTINGS: Any = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9.0,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "text.parse_math": False,  # a $ in the names of a dataset stays a $
    "svg.hashsalt": "ibdata",  # without it, the ids in the file are random
}
WIDTH = 4.8  # of a picture of a dataset, in inches
GREYS = LinearSegmentedColormap.from_list("greys", ["0.82", "0.1"])  # also the lightest differs from white
DPI = 150
DATASET_DPI = 200  # smaller pictures, which the report enlarges
FRAME_DPI = 100
LEFT = 0.015  # of the texts above a picture
COLUMNS = 3  # of a legend
HEADING = 56  # characters of a line above a picture


Ints = npt.NDArray[np.int64]


@contextmanager
def _our_settings() -> Iterator[None]:
    """Use our settings of matplotlib, and restore the user's own afterwards."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(SETTINGS)
        yield


def image(draw: Callable[[Figure], None], form: str, heading: str | None = None, dpi: int = DPI) -> bytes:
    """Render a picture as the bytes of a file.

    Args:
        draw: Draws into an empty figure, and sets its size.
        form: "png" or "svg".
        heading: A text to write above the figure's own title.
        dpi: Pixels per inch of a PNG.
    """
    with _our_settings():
        figure = Figure(layout="constrained")
        draw(figure)
        if heading:
            lines = textwrap.wrap(heading, HEADING)
            figure.suptitle("\n" * len(lines) + figure.get_suptitle(), x=LEFT, ha="left", size=9)
            top = 1.0 - matplotlib.rcParams["figure.constrained_layout.h_pad"] / figure.get_figheight()
            figure.text(LEFT, top, "\n".join(lines), va="top", weight="bold")
        out = io.BytesIO()
        metadata = {"Date": None, "Creator": None} if form == "svg" else {"Software": None}
        figure.savefig(out, format=form, dpi=dpi, metadata=metadata)
        return out.getvalue()


def pixels(draw: Callable[[Figure], None], size: tuple[float, float]) -> npt.NDArray[np.uint8]:
    """Render a picture as an array (height, width, 3)."""
    with _our_settings():
        figure = Figure(figsize=size, dpi=FRAME_DPI, layout="constrained")
        canvas: Any = FigureCanvasAgg(figure)
        draw(figure)
        canvas.draw()
        return np.array(canvas.buffer_rgba())[:, :, :3]


def legend_above(axes: Axes) -> None:
    """Put the legend above the axes, where it hides nothing. Its entries are in rows, not in columns."""
    handles = axes.get_legend_handles_labels()[0]
    by_row = [handle for column in range(COLUMNS) for handle in handles[column::COLUMNS]]
    axes.legend(handles=by_row, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=COLUMNS, borderpad=0.0,
                columnspacing=1.2)  # fmt: skip


def count_image(
    axes: Axes, counts: Any, extent: tuple[float, float, float, float], norm: Any, colors: Any = "cividis"
) -> Any:
    """Draw counts (along x, along y) as an image; 0 is white. extent: low x, high x, low y, high y."""
    shown = np.ma.masked_equal(counts.T, 0)
    return axes.imshow(shown, origin="lower", extent=extent, norm=norm, cmap=colors, aspect="auto",
                       interpolation="nearest")  # fmt: skip


def count_bar(figure: Figure, shown: Any, axes: Any, **options: Any) -> None:
    """Draw the colour bar of an image of counts."""
    bar = figure.colorbar(shown, ax=axes, label="steps", format="{x:,g}", **options)
    bar.ax.xaxis.set_minor_formatter(NullFormatter())
    bar.ax.yaxis.set_minor_formatter(NullFormatter())
