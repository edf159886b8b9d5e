"""The card and meta/croissant.json follow from experiments and manifest; bridges/readers reads both."""

import json
from pathlib import Path

import pytest
from helpers import ROOT
from helpers.folders import seal
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
        off = sum(r["score_error"] ** 2 for r in own) ** 0.5 / 2
        numbers = f"{mean:,.0f} | {error:,.0f} | {mean / 1000:.2f} | {score:.1f} | {off:.1f}"
        row = f"| {policy} | 4 | 1,000 | {numbers} |"
        assert row in lines
    assert any(line.startswith("| all policies | 8 | 1,000 | ") for line in lines)
    assert any(line.startswith(f"Score: {returns['scale']}. One episode ") for line in lines)


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


def described(dataset):
    return json.loads(Path(dataset.path, manifest.CROISSANT).read_bytes())


def by_id(items):
    return {item["@id"]: item for item in items}


def test_a_field_has_the_unit_the_meaning_and_the_bounds_of_its_column(either):
    (rows, *_) = described(either)["recordSet"]
    types = {"int": "Int", "float": "Float", "bool": "Boolean", "string": "Text"}
    assert [field["name"] for field in rows["field"]] == either.table().column_names
    for field, column in zip(rows["field"], either.info["columns"], strict=True):
        kind = column["dtype"].rstrip("3264")
        assert field["dataType"].partition(":")[2] == types[kind] + column["dtype"].removeprefix(kind)
        bounds = (field.get("minValue"), field.get("maxValue"))
        assert (field["description"], field["unitText"], *bounds) == (
            column["description"], column["unit"], column["low"], column["high"],
        )  # fmt: skip


def test_the_files_and_the_splits_are_those_of_the_manifest(dataset):
    told = described(dataset)
    files = by_id(told["distribution"])
    for path, entry in dataset.stored.manifest.entries().items():
        if path != manifest.CROISSANT:
            assert (files[path]["sha256"], files[path]["contentSize"]) == (entry.sha256, f"{entry.bytes} B")
            assert (dataset.path / "meta" / files[path]["contentUrl"]).resolve() == dataset.path / path
    shards = dataset.manifest["shards"]
    sets = by_id(told["recordSet"])
    assert list(sets) == ["rows", "split/source", "split/target", "splits"]
    for name in ("source", "target"):
        paths = [shard["path"] for shard in shards if name in shard["splits"]]
        assert files[f"files/{name}"]["includes"] == paths
        (used,) = {field["source"]["fileSet"]["@id"] for field in sets[f"split/{name}"]["field"]}
        assert used == f"files/{name}"
    counts = {
        row["splits/name"]: (row["splits/episodes"], row["splits/rows"]) for row in sets["splits"]["data"]
    }
    assert counts == {name: (split["episodes"], split["rows"]) for name, split in dataset.splits.items()}


def test_a_description_of_another_form_is_named(copied):
    for text in ("[]", "{", '{"distribution": 1}', "[[1]]"):
        (copied / manifest.CROISSANT).write_text(text)
        seal(copied)
        assert [(p.path, p.rule) for p in ibdata.validate(copied)] == [(manifest.CROISSANT, "metadata")]
