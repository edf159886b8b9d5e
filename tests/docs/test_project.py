"""The project: its version, citation, changelog and workflows, and the bridges to other libraries."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from types import SimpleNamespace

import pytest
from helpers import ROOT
from ruamel.yaml import YAML

import ibdata
from ibdata.version import DATE

PROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
BRIDGES = sorted((ROOT / "scripts/bridges.d").iterdir())


def test_the_citation_names_this_version_and_the_authors():
    citation = YAML(typ="safe").load(ROOT / "CITATION.cff")
    assert citation["version"] == ibdata.__version__
    assert [author["name"] for author in citation["authors"]] == ["The ibdata developers"]
    assert 'authors = [{ name = "The ibdata developers" }]' in PROJECT
    assert citation["license"] == "MIT"
    assert citation["references"][0]["doi"] in (ROOT / "docs/errata.md").read_text(encoding="utf-8")


def test_the_address_stands_in_one_place_and_makes_links_absolute(monkeypatch):
    """Without it, the package's README has no links to the project's files; CITATION.cff names the same."""
    interface = SimpleNamespace(MetadataHookInterface=object)
    monkeypatch.setitem(sys.modules, "hatchling.metadata.plugin.interface", interface)
    absolute = runpy.run_path(str(ROOT / "hatch_build.py"))["absolute"]
    text = "![a b](docs/p.png) [c](docs/c.md#d) [e](https://f) [`g`[0]](h)"
    assert absolute(text, "") == " c [e](https://f) `g`[0]"
    at = "https://host/ibdata"
    shown = f"![a b]({at}/raw/HEAD/docs/p.png) [c]({at}/blob/HEAD/docs/c.md#d) [e](https://f) "
    shown += f"[`g`[0]]({at}/blob/HEAD/h)"
    assert absolute(text, at) == shown
    (address,) = re.findall(r'^address = "(.*?)"', PROJECT, re.MULTILINE)
    assert YAML(typ="safe").load(ROOT / "CITATION.cff").get("repository-code", "") == address


def test_the_changelog_begins_with_this_version():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.split(r"^## ", text, flags=re.MULTILINE)[1]
    assert newest.partition("\n")[0] in [f"{ibdata.__version__}, {day}" for day in ("unreleased", DATE)]
    assert "\n### Data\n" in newest


def test_workflows_and_hooks_call_scripts_only():
    workflows = [YAML(typ="safe").load(path) for path in (ROOT / ".github/workflows").glob("*.yml")]
    jobs = [job for workflow in workflows for job in workflow["jobs"].values()]
    steps = [step["run"] for job in jobs for step in job["steps"] if "run" in step]
    assert len(steps) >= 5
    for line in [*steps, *re.findall(r"entry: (.*)", (ROOT / ".pre-commit-config.yaml").read_text())]:
        assert line.startswith("scripts/")
        assert (ROOT / line.split()[0]).is_file()


def test_no_page_installs_by_name_before_publication():
    """Nothing can be installed by name yet, so pages name a clone, or an extra of an installed ibdata."""
    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        assert not re.search(r"""pip install ["']?ibdata""", page.read_text(encoding="utf-8")), page.name
    assert "not published" in (ROOT / "docs/quickstart.md").read_text(encoding="utf-8")


def test_every_study_has_a_row_and_every_folder_of_tests_a_bridge():
    studies = {path.name for path in (ROOT / "studies").iterdir() if path.is_file() and not path.suffix}
    page = (ROOT / "studies/README.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^\| `(.+?)` \|", page, re.MULTILINE)) == sorted(studies)
    folders = {path.name for path in (ROOT / "tests/bridges").iterdir()}
    assert {path.stem.partition("-")[0] for path in BRIDGES} == folders


@pytest.mark.slow
def test_the_sets_of_the_hub_are_those_of_the_canonical_roots(tmp_path):
    lines = subprocess.run(
        [sys.executable, ROOT / "scripts/hub", "me", "--folder", tmp_path, "--dry-run"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    assert [line.partition(":")[0] for line in lines] == [
        "me/ibdata-random", "me/ibdata-transfer", "me/ibdata-d4rl-like-medium",
    ]  # fmt: skip
    text = (tmp_path / "random/README.md").read_text(encoding="utf-8")
    assert "nobody needs to download it;\nof a copy, `ibdata validate .` compares every row" in text
