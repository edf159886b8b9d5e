"""The literature's 10th percentiles beside those of docs/baselines.md."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

import ibdata
from ibdata.evaluation.baselines import Baseline
from measuring.documents import table
from training.selecting import rank_correlation

# Not published; CQL of weight 50 is compared with the published CQL.
TRAINED = {
    "behaviour": "behaviour",
    "bc": "BC",
    "iql": "IQL",
    "cql-50": "CQL-50",
    "model-based": "model-based",
}
BOTH = {"td3+bc": "TD3+BC", "cql": "CQL", "bcq": "BCQ", "bear": "BEAR"}
FEWEST = 5  # sets for a rank correlation
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
    found = ibdata.baselines(published=True)
    own = ibdata.baselines()
    fixed = own[own["algorithm"] == "cql-50"].set_index("set")["p10"]
    rows = []
    for name, label in BOTH.items():
        each = found[found["algorithm"] == name].set_index("set")
        rows.append(_compared(label, each["p10"], each["published_p10"]))
        if name == "cql":
            rows.append(_compared("CQL of weight 50", fixed, each["published_p10"]))
    head = ["algorithm", "sets", "Spearman's rank correlation", "median distance"]
    return table([*head, "lowest difference", "highest"], rows)


def _compared(label: str, own: pd.Series, published: pd.Series) -> list[Any]:
    """A row of the table, of the sets that both have."""
    both = pd.DataFrame({"own": own, "published": published}).dropna()
    differences = both["own"] - both["published"]
    rank = "–"
    if len(both) >= FEWEST:
        found = rank_correlation(both["published"].to_numpy(), both["own"].to_numpy())
        rank = f"{found:.2f}".replace("-", "−")
    values = (differences.abs().median(), differences.min(), differences.max())
    return [label, len(both), rank, *(shown(x, ".1f") for x in values)]
