"""The picture of docs/baselines.md."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ibdata.evaluation.baselines import BEHAVIOUR, Baseline
from measuring.documents import DOCS
from training.page import LABELS, grouped, references

PICTURE = DOCS / "figures" / "baselines.png"


def draw(lines: Sequence[Baseline], plan: Sequence[Any]) -> None:
    """Draw the mean return of each seed in a panel per set, against the behaviour's and the expert's."""
    import matplotlib.pyplot as plt

    found, names = grouped(lines), [name for name in LABELS if name != BEHAVIOUR]
    sets = list(dict.fromkeys(run.set for run in plan))
    starts = [[s for s in sets if s.startswith(f"siemens-offline/{kind}")] for kind in ("bad", "med", "opt")]
    starts += [[s for s in sets if s.startswith(("siemens-offline/glob", "neorl"))]]
    starts += [[s for s in sets if s.startswith("d4rl")]]
    figure, axes = plt.subplots(5, 5, figsize=(10, 10.5), sharex=True, sharey="row", layout="constrained")
    for line, row in zip(axes, starts, strict=True):
        for axis, name in zip(line, [*row, *[None] * (5 - len(row))], strict=True):
            if name is None:
                axis.set_visible(False)
                continue
            axis.axhline(references()["expert"] / 100, color="0.6", linestyle=":", label="expert")
            for each in found.get((name, BEHAVIOUR), []):
                axis.axhline((each.mean_return or np.nan) / 100, color="#bc4b51", label="behaviour")
            for i, algorithm in enumerate(names):
                values = [
                    x.mean_return for x in found.get((name, algorithm), []) if x.mean_return is not None
                ]
                axis.plot([i] * len(values), np.divide(values, 100), "o", color="#2a6f97", markersize=4)
            axis.set(title=name.replace("siemens-offline/", ""), xlim=(-0.6, len(names) - 0.4))
            axis.set_xticks(range(len(names)), [LABELS[x] for x in names], rotation=90, fontsize=7)
            axis.tick_params(labelbottom=True)
            axis.title.set_fontsize(9)
    handles = axes[0, 0].get_lines()[:2]  # beside the panels, where they hide no result
    figure.legend(handles=handles, loc="outside upper right", ncols=2, fontsize=8)
    done = sum(line.algorithm != BEHAVIOUR for line in lines)
    figure.suptitle(f"{done} of {sum(run.algorithm != BEHAVIOUR for run in plan)} runs", fontsize=9)
    figure.supylabel("mean return / 100 of each seed")
    figure.savefig(PICTURE, dpi=110)
