"""docs/canonical.md lists the dataset of every shipped experiment; each is made here at reduced size."""

from __future__ import annotations

import json
import re

import pytest
from helpers import ROOT, script

import ibdata
from ibdata.evaluation.baselines import shipped_baselines
from ibdata.experiment import shipped
from measuring.documents import measured

TEXT = (ROOT / "docs/canonical.md").read_text(encoding="utf-8")
STORED = json.loads((ROOT / "docs/canonical.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def canonical():
    return script("canonical")


def test_every_shipped_experiment_is_listed_with_its_rows():
    assert list(STORED) == list(shipped())
    assert {name: found["rows"] for name, found in STORED.items()} == {
        name: ibdata.load(name).rows for name in shipped()
    }


@pytest.mark.parametrize("name", shipped())
def test_at_reduced_size_an_experiment_has_the_stored_root(canonical, name):
    """At full size, scripts/release compares it."""
    assert canonical.root(ibdata.load(name).part(**canonical.SMALL)) == STORED[name]["small_root"]


def test_a_set_that_is_made_again_has_the_stored_figures(canonical, tmp_path):
    assert canonical.measure("drifting", tmp_path / "made") == STORED["drifting"]


def test_the_table_is_that_of_the_stored_figures(canonical):
    assert measured(TEXT).strip() == canonical.listed(STORED)
    assert STORED["random"]["content_root"] in TEXT.partition("<!--")[0]


def test_other_documents_name_the_same_roots():
    quality = json.loads((ROOT / "docs/quality.json").read_text(encoding="utf-8"))
    whole = {name: q for name, q in quality.items() if q["episodes"] == STORED[name]["episodes"]}
    assert len(whole) > 20
    roots = {(name, found["content_root"]) for name, found in whole.items()}
    roots |= {(line.set, line.content_root) for line in shipped_baselines()}
    assert {name: root for name, root in roots if root != STORED[name]["content_root"]} == {}


def test_the_release_makes_all_of_them_in_full():
    release = (ROOT / "scripts/release").read_text(encoding="utf-8")
    assert re.search(r"canonical.*\ngit diff --exit-code", release, re.DOTALL)
