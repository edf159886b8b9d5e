"""The episode with the median return: observed variables and, if the dataset has them, hidden ones."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ibdata.plots.episode import VARIABLES, draw_episode
from ibdata.plots.style import WIDTH, Floats
from ibdata.plots.summary import Summary

TITLE = "One episode"
MOST_STEPS = 300  # more could not be told apart


def draw(figure: Figure, summary: Summary) -> None:
    """Draw the panels of `ibdata.plots.episode`."""
    median = np.quantile(summary.returns, 0.5, method="inverted_cdf")
    episode = summary.episodes.iloc[np.argmax(summary.returns == median)]  # the first of several
    steps = traces(summary, episode)
    figure.set_size_inches(WIDTH, 5.4 if "mu_v" in steps else 3.4)
    draw_episode(figure, steps)
    figure.axes[-1].set_xlim(0, max(1, len(steps["setpoint"]) - 1))
    cut = f", first {MOST_STEPS:,} steps" if episode["length"] > MOST_STEPS else ""
    figure.suptitle(
        f"episode {episode['episode']:,}, the one with the median return{cut}\n"
        f"{summary.setpoint_label} = {episode['setpoint']:g}, {episode['policy']}"
    )


def traces(summary: Summary, episode: Any) -> Mapping[str, Floats]:
    """The first steps of an episode: variables by name, with the hidden ones that the dataset has."""
    known = {column.name for column in summary.dataset.stored.info.columns}
    both = {column: name for name in VARIABLES for column in (f"obs_{name}", f"latent_{name}")}
    names = [column for column in both if column in known]
    first, stop = int(episode["row_start"]), int(episode["row_stop"])
    batches = summary.dataset.stored.batches(
        int(episode["shard"]), names, MOST_STEPS, first, min(stop, first + MOST_STEPS)
    )
    parts = [np.stack([column.to_numpy() for column in batch.columns]) for batch in batches]
    return dict(zip([both[name] for name in names], np.concatenate(parts, axis=1), strict=True))
