"""The table of docs/views.md shows what scripts/views measured."""

from __future__ import annotations

import json
import re
from statistics import mean

from helpers import ROOT

FOUND = json.loads((ROOT / "docs/figures/views.json").read_text(encoding="utf-8"))
PAGE = (ROOT / "docs/views.md").read_text(encoding="utf-8")


def test_the_page_shows_each_measured_return():
    shown = re.findall(r"^\| (.+?) \| (−\d+\.\d\d) \| (.+?) \|$", PAGE, flags=re.MULTILINE)
    expected = [
        (
            name,
            f"{mean(one['return'] for one in seeds.values()):.2f}".replace("-", "−"),
            ", ".join(f"{one['return']:.2f}".replace("-", "−") for one in seeds.values()),
        )
        for name, seeds in FOUND["returns"].items()
    ]
    assert shown == expected


def test_the_page_says_how_it_was_measured():
    assert f"`{FOUND['dataset']}`" in PAGE
    assert f"{FOUND['steps']:,} steps" in PAGE
    assert f"{FOUND['episodes']} new episodes" in PAGE
    largest = max(one["standard_error"] for seeds in FOUND["returns"].values() for one in seeds.values())
    assert f"at most {largest:.2f}" in PAGE
