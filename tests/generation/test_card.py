"""The card says under which licence a dataset is, how well its behaviour does, and how to cite it."""

from pathlib import Path

import pytest
from helpers import ROOT
from ruamel.yaml import YAML

import ibdata
from ibdata.dataset import manifest
from ibdata.generation.card import PAPER, front_matter

SMALL = {"name": "small", "setpoints": 70, "policies": ["random"], "episodes": 2, "steps": 3}


@pytest.fixture
def small(made_at, tmp_path):
    return made_at(SMALL, tmp_path / "small")


def text_of(dataset):
    return Path(dataset.path, manifest.CARD).read_text(encoding="utf-8")


def matter_of(dataset):
    return YAML(typ="safe", pure=True).load(text_of(dataset).split("---\n")[1])


def test_the_licence_is_in_the_table_and_in_the_front_matter(small, tmp_path):
    assert matter_of(small)["license"] == "cc-by-4.0"
    assert "| licence | `CC-BY-4.0` |" in text_of(small)
    mine = ibdata.generate({**SMALL, "licence": "LicenseRef-mine"}, tmp_path / "mine", workers=1)
    matter = matter_of(mine)
    assert (matter["license"], matter["license_name"]) == ("other", "LicenseRef-mine")
    assert "| licence | `LicenseRef-mine` |" in text_of(mine)
    assert mine.content_root == small.content_root


def test_the_hub_knows_licences_by_its_own_words():
    assert front_matter(["PDDL-1.0", "cc0-1.0"]) == ["license: [pddl, cc0-1.0]"]
    expected = ["license: [mit, other]", 'license_name: "1e3, Y-2"']
    assert front_matter(["MIT", "1e3", "Y-2"]) == expected


def test_the_behaviour_has_its_returns_and_its_scores(tmp_path):
    experiment = {**SMALL, "setpoints": [20, 70], "policies": ["random", "optimized"], "steps": 1000}
    made = ibdata.generate(experiment, tmp_path / "long", workers=1)
    lines, frame, returns = text_of(made).splitlines(), made.episodes, made.returns()
    for policy in ("random", "optimized"):
        own = [r for r in returns["results"] if r["policy"] == policy]
        mean = frame[frame["policy"] == policy]["return"].mean()
        error = sum(r["standard_error"] ** 2 for r in own) ** 0.5 / 2
        score = sum(r["score"] for r in own) / 2
        row = f"| {policy} | 4 | 1,000 | {mean:,.0f} | {error:,.0f} | {mean / 1000:.2f} | {score:.1f} |"
        assert row in lines
    assert any(line.startswith("| all policies | 8 | 1,000 | ") for line in lines)
    assert f"Score: {returns['scale']}." in lines


def test_the_card_says_how_to_cite_as_the_documents_do(small):
    text = text_of(small)
    citation = YAML(typ="safe").load(ROOT / "CITATION.cff")
    [paper] = citation["references"]
    assert PAPER in text
    assert PAPER in (ROOT / "docs/reproducibility.md").read_text(encoding="utf-8")
    assert f"{{{paper['title']}}}" in PAPER
    assert f"{{{paper['conference']['name']}}}" in PAPER
    assert paper["url"].endswith("1709.09480")
    for author in paper["authors"]:
        assert f"{author['family-names']}, {author['given-names']}" in " ".join(PAPER.split())
    assert f"title   = {{{citation['title']}}}" in text
    assert f"version = {{{ibdata.__version__}}}" in text
    assert f"{{Dataset small, content root {small.content_root}}}" in text
