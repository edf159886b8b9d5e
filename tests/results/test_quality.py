"""docs/quality.md shows what scripts/quality has stored, and that can be measured again."""

from __future__ import annotations

import json

import pytest
from helpers import ROOT
from helpers import script as load

from ibdata.experiment import shipped
from measuring.documents import measured

TEXT = (ROOT / "docs/quality.md").read_text(encoding="utf-8")
STORED = json.loads((ROOT / "docs/quality.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def script():
    return load("quality")


def test_the_table_is_that_of_the_stored_results(script):
    assert measured(TEXT).strip() == script.listed(STORED)


def test_every_shipped_set_has_a_row(script):
    assert set(STORED) == set(shipped()) - script.LEFT_OUT


def test_a_set_that_is_measured_again_has_the_stored_results(script, tmp_path):
    assert script.measure("drifting", tmp_path / "made") == pytest.approx(STORED["drifting"])


def test_the_text_agrees_with_the_table():
    worse = {name for name, found in STORED.items() if (found["trajectory_quality"] or 0.0) < -0.1}
    sets = {f"siemens-offline/{name}" for name in ("mediocre-60", "mediocre-80")}
    sets |= {f"siemens-offline/bad-{share}" for share in (0, 20, 40, 60, 80)}
    assert worse == sets | {"d4rl-like/medium-replay", "d4rl-like-all/medium-replay", "neorl-like/low"}
    assert [STORED[f"siemens-offline/{name}-0"]["pairs"] for name in ("bad", "mediocre")] == [14, 12]
    covered = [STORED[f"siemens-offline/{name}-80"]["state_action_coverage"] for name in ("bad", "optimized")]
    assert [round(100 * x) for x in covered] == [15, 27]
    assert STORED["siemens-offline/optimized-0"]["action_entropy"] == 0.0
