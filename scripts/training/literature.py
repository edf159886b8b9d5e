"""The literature's 10th percentiles beside those of docs/baselines.md."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

import ibdata
from ibdata.evaluation.baselines import Baseline
from measuring.documents import table
from training.selecting import rank_correlation

TRAINED = {"behaviour": "behaviour", "bc": "BC", "iql": "IQL"}  # not published
BOTH = {"td3+bc": "TD3+BC", "cql": "CQL", "bcq": "BCQ", "bear": "BEAR"}
ONLY = {"moose": "MOOSE", "wsbc": "WSBC", "brac-v": "BRAC-v", "mopo": "MOPO", "morel": "MOReL"}


def shown(value: float | None, form: str) -> str:
    """A return in hundreds, or – if there is none."""
    return "–" if value is None or np.isnan(value) else format(value / 100, form).replace("-", "−")


def percentiles(lines: Sequence[Baseline]) -> str:
    """A Markdown table of the 10th percentiles of the sets that the literature has."""
    found = ibdata.baselines(published=True)
    known = found.pivot(index="set", columns="algorithm", values="published_p10")
    own = pd.DataFrame([{"set": x.set, "algorithm": x.algorithm, "p10": x.p10} for x in lines])
    means = own.groupby(["set", "algorithm"])["p10"].mean().to_dict()
    rows = []
    for name in known.index:
        cells = [shown(means.get((name, each)), ".1f") for each in TRAINED]
        for each in BOTH:
            here = shown(means.get((name, each)), ".1f")
            cells.append(f"{here} / {shown(known.loc[name, each], '.4g')}")
        cells += [shown(known.loc[name, each], ".4g") for each in ONLY]
        rows.append([f"`{name.partition('/')[2]}`", *cells])
    return table(["set", *TRAINED.values(), *BOTH.values(), *ONLY.values()], rows)


def comparison() -> str:
    """A Markdown table that says how far the results of an algorithm are from the published ones."""
    found = ibdata.baselines(published=True).dropna()
    rows = []
    for name, label in BOTH.items():
        own = found[found["algorithm"] == name]
        differences = own["difference"]
        rank = rank_correlation(own["published_p10"].to_numpy(), own["p10"].to_numpy())
        values = (differences.abs().median(), differences.min(), differences.max())
        rows.append([label, len(own), f"{rank:.2f}", *(shown(x, ".1f") for x in values)])
    head = ["algorithm", "sets", "Spearman's rank correlation", "median distance"]
    return table([*head, "lowest difference", "highest"], rows)
