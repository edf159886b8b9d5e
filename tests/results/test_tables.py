"""Pages show the results that are stored beside them, and these can be made again."""

from __future__ import annotations

import json

import numpy as np
import pytest
from helpers import ROOT, script

import ibdata
from ibdata.evaluation.baselines import FILE, shipped_baselines
from ibdata.experiment import shipped
from measuring.documents import filled, measured
from training import prose


def page(name):
    return (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")


def stored(name):
    return json.loads((ROOT / "docs" / f"{name}.json").read_text(encoding="utf-8"))


CANONICAL, QUALITY, MODELS = map(stored, ("canonical", "quality", "world-models"))


@pytest.mark.parametrize(
    ("study", "name"),
    [("canonical", "sets"), ("quality", "quality"), ("world-models", "quality")],
)
def test_a_table_is_that_of_the_stored_results(study, name):
    assert measured(page(name), f"measured, {study}").strip() == script(study).table_of(stored(study))


def test_the_numbers_in_sentences_are_those_of_the_results():
    for name, values in prose.numbers().items():
        text = (ROOT / name).read_text(encoding="utf-8")
        assert filled(text, values) == text, name


def test_every_shipped_set_has_a_row():
    assert {name: found["rows"] for name, found in CANONICAL.items()} == {
        name: ibdata.load(name).rows for name in shipped()
    }
    assert list(CANONICAL) == list(shipped())
    assert set(QUALITY) == set(shipped()) - script("quality").LEFT_OUT


@pytest.mark.parametrize("name", ["canonical", "quality"])
def test_a_set_that_is_made_again_has_the_stored_figures(name, tmp_path):
    again = script(name).measure("drifting", tmp_path / "made")
    assert again == pytest.approx(stored(name)["drifting"])


@pytest.mark.parametrize("name", shipped())
def test_at_reduced_size_an_experiment_has_the_stored_root(name):
    """At full size, scripts/release compares it."""
    canonical = script("canonical")
    assert canonical.root(ibdata.load(name).part(**canonical.SMALL)) == CANONICAL[name]["small_root"]


def test_other_documents_name_the_same_roots():
    assert CANONICAL["random"]["content_root"] in page("reproducibility").partition("<!--")[0]
    whole = {name: q for name, q in QUALITY.items() if q["episodes"] == CANONICAL[name]["episodes"]}
    assert len(whole) > 20
    roots = {(name, found["content_root"]) for name, found in whole.items()}
    roots |= {(line.set, line.content_root) for line in shipped_baselines([FILE])}
    assert {name: root for name, root in roots if root != CANONICAL[name]["content_root"]} == {}


def test_the_text_about_quality_agrees_with_the_table():
    worse = {name for name, found in QUALITY.items() if (found["trajectory_quality"] or 0.0) < -0.1}
    sets = {f"siemens-offline/{name}" for name in ("mediocre-60", "mediocre-80")}
    sets |= {f"siemens-offline/bad-{share}" for share in (0, 20, 40, 60, 80)}
    sets |= {"drifting", "d4rl-like/medium-replay", "d4rl-like-all/medium-replay", "neorl-like/low"}
    assert worse == sets
    assert QUALITY["siemens-offline/optimized-0"]["action_entropy"] == 0.0


def test_ridge_regression_is_between_persistence_and_the_floor(tmp_path):
    changes = {"episodes": 95, "steps": 100}
    ds = ibdata.generate("siemens-offline/optimized-40", tmp_path / "made", workers=1, overrides=changes)
    models = script("world-models")
    fitted = {name: models.MODELS[name] for name in ("persistence", "ridge regression")}
    for found in models.measure(ds, fitted).values():
        errors = {name: np.array(each["root_mean_square"]) for name, each in found.items()}
        assert np.all(errors["ridge regression"] < errors["persistence"])
        assert np.all(0.9 * errors["noise floor"] < errors["ridge regression"])  # 5 episodes scatter
        assert 2.0 * errors["noise floor"][1] < errors["ridge regression"][1]
        np.testing.assert_allclose(errors["mean of the law"], errors["noise floor"], rtol=0.2)


def test_the_text_about_world_models_agrees_with_the_tables():
    def over(name, horizon, model, column):
        found = MODELS[f"siemens-offline/{name}"][horizon]
        errors = (found[key]["root_mean_square"][column] for key in (model, "noise floor"))
        return np.divide(*errors)

    learned = [over("optimized-40", h, m, 0) for h in ("1", "10") for m in ("ridge regression", "network")]
    assert max(learned) < 1.04
    sets = ("global-100", "optimized-40")
    assert min(over(name, "1", "ridge regression", 1) for name in sets) > 3
