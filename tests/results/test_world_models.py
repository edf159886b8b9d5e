"""docs/world-models.md shows what scripts/world-models has stored, and its models predict as they say."""

from __future__ import annotations

import json

import numpy as np
import pytest
from helpers import ROOT
from helpers import script as load

import ibdata
from measuring.documents import measured

STORED = json.loads((ROOT / "docs/world-models.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def script():
    return load("world-models")


def test_the_tables_are_those_of_the_stored_results(script):
    text = (ROOT / "docs/world-models.md").read_text(encoding="utf-8")
    assert measured(text).strip() == script.listed(STORED)


@pytest.fixture(scope="module")
def ds(tmp_path_factory):
    folder = tmp_path_factory.mktemp("models") / "made"
    changes = {"episodes": 95, "steps": 100}
    return ibdata.generate("siemens-offline/optimized-40", folder, workers=1, overrides=changes)


def test_ridge_regression_is_between_persistence_and_the_floor(script, ds):
    models = {name: script.MODELS[name] for name in ("persistence", "ridge regression")}
    for found in script.measure(ds, models).values():
        errors = {name: np.array(each["root_mean_square"]) for name, each in found.items()}
        assert np.all(errors["ridge regression"] < errors["persistence"])
        assert np.all(0.9 * errors["noise floor"] < errors["ridge regression"])  # 5 episodes scatter
        assert 2.0 * errors["noise floor"][1] < errors["ridge regression"][1]
        np.testing.assert_allclose(errors["mean of the law"], errors["noise floor"], rtol=0.2)


def test_the_text_agrees_with_the_tables():
    def over(name, horizon, model, column):
        found = STORED[f"siemens-offline/{name}"][horizon]
        errors = (found[key]["root_mean_square"][column] for key in (model, "noise floor"))
        return np.divide(*errors)

    learned = [over("optimized-40", h, m, 0) for h in ("1", "10") for m in ("ridge regression", "network")]
    assert max(learned) < 1.03
    assert [round(over("global-100", h, "network", 0), 2) for h in ("1", "10")] == [1.08, 1.42]
    sets = ("global-100", "optimized-40")
    assert min(over(name, "1", "ridge regression", 1) for name in sets) > 3
    assert [round(over(name, "1", "network", 1), 1) for name in sets] == [2.5, 1.9]
    found = [over("global-100", "10", model, 1) for model in ("network", "ridge regression")]
    assert np.round(found, 1).tolist() == [5.5, 22.6]
