"""What is published: the version, the citation, the changelog, and the links of the packaged README."""

from __future__ import annotations

import re

from helpers import ROOT
from ruamel.yaml import YAML

import ibdata

PROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def test_the_citation_names_this_version_and_the_authors_of_the_package():
    citation = YAML(typ="safe").load(ROOT / "CITATION.cff")
    assert citation["version"] == ibdata.__version__
    assert [author["name"] for author in citation["authors"]] == ["The ibdata developers"]
    assert 'authors = [{ name = "The ibdata developers" }]' in PROJECT
    assert citation["license"] == "MIT"
    assert citation["references"][0]["doi"] in (ROOT / "docs/errata.md").read_text(encoding="utf-8")


def test_the_changelog_begins_with_this_version_and_says_what_became_of_the_data():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.split(r"^## ", text, flags=re.MULTILINE)[1]
    assert newest.startswith(ibdata.__version__)
    assert "\n### Data\n" in newest


def test_the_pythons_of_the_classifiers_are_those_of_the_workflow():
    named = re.findall(r'"Programming Language :: Python :: (3\.\d+)"', PROJECT)
    (tested,) = re.findall(r"python: \[(.*)\]", (ROOT / ".github/workflows/tests.yml").read_text())
    assert named == re.findall(r"3\.\d+", tested)
    assert f'requires-python = ">={named[0]}"' in PROJECT


def test_workflows_and_the_hook_before_a_commit_call_scripts_only():
    workflows = [YAML(typ="safe").load(path) for path in (ROOT / ".github/workflows").glob("*.yml")]
    jobs = [job for workflow in workflows for job in workflow["jobs"].values()]
    steps = [step["run"] for job in jobs for step in job["steps"] if "run" in step]
    assert len(steps) >= 5
    for line in [*steps, *re.findall(r"entry: (.*)", (ROOT / ".pre-commit-config.yaml").read_text())]:
        assert line.startswith("scripts/")
        assert (ROOT / line.split()[0]).is_file()


def test_what_the_documents_say_of_installing_is_true_before_it_is_published():
    """Nothing can be installed by name yet, so pages name a clone, or an extra of an installed ibdata."""
    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        assert not re.search(r"""pip install ["']?ibdata""", page.read_text(encoding="utf-8")), page.name
    assert "not published" in (ROOT / "docs/install.md").read_text(encoding="utf-8")
