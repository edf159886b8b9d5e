"""How far the 10th percentiles of docs/baselines.md are from the published ones."""

from __future__ import annotations

from typing import Any

import pandas as pd

import ibdata
from measuring.documents import table
from training.selecting import rank_correlation

BOTH = {"td3+bc": "TD3+BC", "cql": "CQL", "bcq": "BCQ", "bear": "BEAR"}
FEWEST = 5  # sets for a rank correlation


def shown(value: float) -> str:
    """A return in hundreds."""
    return f"{value / 100:.1f}".replace("-", "−")


def comparison() -> str:
    """A Markdown table of the algorithms that the literature has, too, and of CQL-50 beside CQL."""
    found = ibdata.baselines(published=True)
    own = ibdata.baselines()
    fixed = own[own["algorithm"] == "cql-50"].set_index("set")["p10"]
    rows = []
    for name, label in BOTH.items():
        each = found[found["algorithm"] == name].set_index("set")
        rows.append(_compared(label, each["p10"], each["published_p10"]))
        if name == "cql":
            rows.append(_compared("CQL of weight 50", fixed, each["published_p10"]))
    head = ["algorithm", "sets", "rank correlation", "median distance"]
    return table([*head, "lowest", "highest"], rows)


def _compared(label: str, own: pd.Series, published: pd.Series) -> list[Any]:
    """A row of the table, of the sets that both have."""
    both = pd.DataFrame({"own": own, "published": published}).dropna()
    differences = both["own"] - both["published"]
    rank = "–"
    if len(both) >= FEWEST:
        found = rank_correlation(both["published"].to_numpy(), both["own"].to_numpy())
        rank = f"{found:.2f}".replace("-", "−")
    values = (differences.abs().median(), differences.min(), differences.max())
    return [label, len(both), rank, *(shown(x) for x in values)]
