"""The pages and the README name what exists, and figures stand where their proof is."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from helpers import ROOT
from helpers.pages import blocks, check_guide
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
LINKED = [*DOCS.glob("*.md"), *ROOT.glob("*.md"), *ROOT.glob("studies/**/*.md")]
SECTIONS = {
    name: pages for part in YAML(typ="safe").load(ROOT / "mkdocs.yml")["nav"] for name, pages in part.items()
}
TITLES = {title: page for pages in SECTIONS.values() for entry in pages for title, page in entry.items()}
PROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
EXTRAS = re.findall(
    r"^([\w-]+) = \[", PROJECT.split("[project.optional-dependencies]")[1].split("\n[")[0], flags=re.MULTILINE
)


@pytest.mark.parametrize("page", LINKED, ids=lambda path: str(path.relative_to(ROOT)))
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
    assert sorted(TITLES.values()) == sorted([*PAGES, *(path.name for path in DOCS.glob("*.ipynb"))])


def test_a_page_that_the_package_names_is_in_the_navigation():
    """By its title, because who installed a wheel has no file of docs/."""
    texts = {path: path.read_text(encoding="utf-8") for path in (ROOT / "ibdata").rglob("*.py")}
    paths = {path.name for path, text in texts.items() if re.search(r"docs/[\w-]+\.md", text)}
    assert paths <= {"__init__.py"}  # the map of the rooms, for contributors
    named = re.findall(r"""\bpages?\s+["'](\w[\w\s,']+?)["'](?=[\s)"]|$)""", "\n".join(texts.values()))
    assert len(named) > 10
    assert {" ".join(title.split()) for title in named} <= set(TITLES)


def test_the_experiment_that_is_explained_is_valid(tmp_path):
    (shown,) = (x for x in blocks(PAGES["experiments.md"], "yaml") if x.startswith("# explained.yaml\n"))
    (tmp_path / "explained.yaml").write_text(shown)
    experiment = ibdata.load(tmp_path / "explained.yaml")
    assert len(experiment.cells) == 12
    assert experiment.labels == ("random", "safe", "constant", "bad", "explored", "gaussian")


def test_every_shipped_experiment_is_named_and_every_policy_that_is_named_exists():
    for name in [*shipped(), *suites()]:
        assert f"`{name}`" in PAGES["sets.md"], name
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


def test_no_page_is_too_long_to_be_read_at_once():
    """In words of prose, without code, tables, generated parts, the glossary and names of tests."""
    assert len(TITLES) <= 34
    guide = {page for entry in SECTIONS["Guide"] for page in entry.values()}
    for name in set(PAGES) - {"glossary.md"}:
        prose = re.sub(r"<!-- ([\w, -]+) -->\n.*?<!-- /\1 -->", "", PAGES[name], flags=re.DOTALL)
        named = r"^```.*?^```$|^\|.*?$|`tests?[/_][\w./]+`[,.]?"
        prose = re.sub(named, "", prose, flags=re.MULTILINE | re.DOTALL)
        assert len(prose.split()) <= (900 if name in guide else 1_200), name


@pytest.mark.parametrize(("page", "points"), [("docs/promises.md", 27), ("SECURITY.md", 7)])
def test_each_promise_names_tests(page, points):
    """Which exist, as all paths of pages: see above."""
    text = (ROOT / page).read_text(encoding="utf-8").replace("\n  ", " ")
    promises = re.findall(r"^- \*\*.*$", text, re.MULTILINE)
    assert len(promises) == points
    for promise in promises:
        assert re.search(r"`tests/[\w./]+`", promise), promise


def test_the_promises_count_the_naive_uses():
    files = "".join(path.read_text() for path in (ROOT / "tests/naive").glob("test_*.py"))
    uses = len(re.findall(r"^def test_", files, re.MULTILINE))
    assert f"** {uses} things that people do in a normal year" in PAGES["promises.md"]


README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)
SHELL = [line for language, block in BLOCKS if language == "sh" for line in block.splitlines()]
PROVEN = "".join((ROOT / "docs" / page).read_text(encoding="utf-8") for page in ("promises.md", "errata.md"))


def test_it_is_short_and_begins_with_the_two_commands():
    assert len(README.split()) <= 750
    assert SHELL[0].endswith("ibdata generate --config random.yaml")
    assert SHELL[1] == "scripts/test"
    assert "README.md" in (ROOT / ".ci/run").read_text()


@pytest.mark.slow
def test_the_lines_of_your_own_experiment_print_what_they_say(tmp_path: Path):
    section = README[README.index("## Your own") : README.index("## Paper or siemens?")]
    check_guide(section, tmp_path)


@pytest.mark.parametrize(
    "figure", ["1e-12", "100,000", "3,262", "185", "5,913", "727", "166", "338", "8 and 6"]
)
def test_a_measured_figure_stands_where_its_proof_is(figure: str):
    """The medians of the run-away are 338, 205 and 166 steps by the code, and 8, 7 and 6 as printed."""
    assert figure in README
    assert {"8 and 6": "8 / 7 / 6"}.get(figure, figure) in PROVEN


def test_the_speed_is_the_one_that_was_measured():
    measured = (ROOT / "docs/performance.md").read_text(encoding="utf-8")
    ratio = re.search(r"^\| one processor, .* published package .*? \| (\d+) × \|", measured, re.MULTILINE)[1]
    low, high = map(int, re.search(r"(\d+) to (\d+) times, by machine", measured).groups())
    assert low <= int(ratio) <= high
    assert "about 100 times as fast as the published package" in " ".join(README.split())
    each = int(re.search(r"^\| 10,000,000 transitions \| (\d+) ns each", measured, re.MULTILINE)[1])
    assert f"{math.floor(10_000 / each) / 10} million transitions a second" in README


def test_the_columns_and_formats_are_those_that_exist():
    assert f"{len(FORMATS)} export formats" in " ".join(README.split())
    page = (ROOT / "docs/dataset-format.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.+?) \|", README, flags=re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`([\w*]+)`", row)}
    assert len(named) == 11
    assert all(f"`{name.removesuffix('*')}" in page for name in named)
