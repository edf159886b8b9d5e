"""The pages name what exists: links, pages, experiments, policies, exit codes, formats and extras."""

from __future__ import annotations

import re

import pytest
from helpers import ROOT
from helpers.pages import blocks
from ruamel.yaml import YAML

import ibdata
from ibdata.cli import cli
from ibdata.experiment import shipped, suites
from ibdata.exporters import FORMATS
from ibdata.exporters.rllib import SCHEMA
from ibdata.policies import POLICIES

DOCS = ROOT / "docs"
PAGES = {path.name: path.read_text(encoding="utf-8") for path in DOCS.glob("*.md")}
USE_WITH = PAGES["use-with.md"]
LINKED = [*DOCS.glob("*.md"), *ROOT.glob("*.md"), ROOT / "studies/README.md"]
PROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
EXTRAS = re.findall(
    r"^([\w-]+) = \[", PROJECT.split("[project.optional-dependencies]")[1].split("\n[")[0], flags=re.MULTILINE
)


@pytest.mark.parametrize("page", LINKED, ids=lambda path: path.name)
def test_links_pictures_and_paths_lead_somewhere(page):
    """Among the paths in backticks, a bare `test_x.py` is a file beside the one named before it."""
    text = page.read_text(encoding="utf-8")
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    links = [target for target in re.findall(r"\]\(([^)#\s]+)", prose) if "://" not in target]
    assert [target for target in links if not (page.parent / target).exists()] == []
    folder, missing = ROOT, []
    for name in re.findall(
        r"`((?:ibdata|tests|scripts|studies|configs|docs|\.ci)/[\w./-]+|test_\w+\.py)`", text
    ):
        path = ROOT / name if "/" in name else folder / name
        folder = path.parent
        if not path.exists():
            missing.append(name)
    assert missing == []


def test_the_navigation_names_every_page_once():
    def named(entry):
        if isinstance(entry, str):
            return [entry]
        parts = entry if isinstance(entry, list) else entry.values()
        return [page for part in parts for page in named(part)]

    pages = named(YAML(typ="safe").load(ROOT / "mkdocs.yml")["nav"])
    assert sorted(pages) == sorted([*PAGES, *(path.name for path in DOCS.glob("*.ipynb"))])


def test_the_experiment_that_is_explained_is_valid(tmp_path):
    (shown,) = (x for x in blocks(PAGES["experiments.md"], "yaml") if x.startswith("# explained.yaml\n"))
    (tmp_path / "explained.yaml").write_text(shown)
    experiment = ibdata.load(tmp_path / "explained.yaml")
    assert len(experiment.cells) == 12
    assert experiment.labels == ("random", "safe", "constant", "bad", "explored", "gaussian")


def test_every_shipped_experiment_is_named_and_every_policy_that_is_named_exists():
    for name in {name.partition("/")[0] for name in shipped()} | set(suites()):
        assert f"| `{name}` |" in PAGES["experiments.md"], name
    assert set(re.findall(r"\bkind: ([a-z_]+)\b", "".join(PAGES.values()))) <= set(POLICIES)


def test_every_exit_code_is_explained():
    found = {int(code) for code in re.findall(r"^\| `\w+` \| (\d+) \|", PAGES["cli.md"], re.M)}
    table = PAGES["cli.md"].partition("## Exceptions")[0]
    explained = {int(n) for codes in re.findall(r"^\| ([\d, ]+) \|", table, re.M) for n in codes.split(",")}
    assert explained == found | {0, 129, 130, 143}


def test_the_pages_show_every_command_and_no_other():
    shown = re.findall(r"^ibdata ([a-z]+)", "".join(blocks("\n".join(PAGES.values()), "sh")), re.M)
    assert set(shown) == set(cli.list_commands(None))


def test_a_bridge_runs_the_snippets_of_each_section():
    """Those of docs/use-with.md need the libraries of which they tell."""
    tests = "".join(path.read_text() for path in (ROOT / "tests/bridges").rglob("test_*.py"))
    sections = re.split(r"^## (.+)\n", USE_WITH, flags=re.MULTILINE)[1:]
    pairs = zip(sections[::2], sections[1::2], strict=True)
    headings = [heading for heading, text in pairs if "```python" in text]
    assert len(headings) > 5
    assert [heading for heading in headings if f'"{heading}"' not in tests] == []


def test_the_page_of_libraries_names_what_exists():
    assert set(re.findall(r"--to (\w+)", USE_WITH)) == set(FORMATS)
    named = set(re.findall(r"\| `([\w-]+)` \|", USE_WITH.split("\n## ")[0]))
    assert named
    assert named <= set(EXTRAS)
    for key, column in SCHEMA.items():
        assert f'    "{key}": "{column}",\n' in USE_WITH


def test_the_documentation_stays_short():
    """In words as `wc -w` counts them, of which the guide is what a user reads in order."""
    [guide] = (part["Guide"] for part in YAML(typ="safe").load(ROOT / "mkdocs.yml")["nav"] if "Guide" in part)
    read = {page for entry in guide for page in entry.values()}
    words = {name: len(text.split()) for name, text in PAGES.items()}
    assert len(list(DOCS.glob("*.md")) + list(DOCS.glob("*.ipynb"))) <= 30
    assert sum(words.values()) <= 25_000
    assert sum(words[name] for name in read & set(words)) <= 7_000
