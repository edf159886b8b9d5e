"""The pages of docs/ name what exists: in the navigation, as experiments, policies, exit codes and words."""

from __future__ import annotations

import re

import pytest
from helpers import ROOT
from ruamel.yaml import YAML

import ibdata
from ibdata.cli import cli
from ibdata.experiment import shipped, suites
from ibdata.policies import POLICIES

DOCS = ROOT / "docs"
PAGES = {path.name: path.read_text(encoding="utf-8") for path in DOCS.glob("*.md")}


def test_the_navigation_names_every_page_once():
    def named(entry):
        if isinstance(entry, str):
            return [entry]
        return [
            page for each in (entry if isinstance(entry, list) else entry.values()) for page in named(each)
        ]

    pages = named(YAML(typ="safe").load(ROOT / "mkdocs.yml")["nav"])
    assert sorted(pages) == sorted([*PAGES, *(path.name for path in DOCS.glob("*.ipynb"))])


def test_every_page_has_one_title():
    for name, text in PAGES.items():
        prose = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
        assert name == "changelog.md" or len(re.findall(r"^# ", prose, flags=re.MULTILINE)) == 1, name


def test_the_experiment_that_is_explained_is_valid(tmp_path):
    (shown,) = re.findall(r"^```yaml\n(# explained\.yaml\n.*?)^```$", PAGES["experiments.md"], re.M | re.S)
    (tmp_path / "explained.yaml").write_text(shown)
    experiment = ibdata.load(tmp_path / "explained.yaml")
    assert len(experiment.cells) == 12
    assert experiment.labels == ("random", "safe", "constant", "bad", "explored", "gaussian")


def test_every_shipped_experiment_is_named():
    for name in {name.partition("/")[0] for name in shipped()} | set(suites()):
        assert f"| `{name}` |" in PAGES["experiments.md"], name


@pytest.mark.parametrize("page", sorted(PAGES))
def test_every_policy_that_is_named_exists(page):
    assert set(re.findall(r"\bkind: ([a-z_]+)\b", PAGES[page])) <= set(POLICIES)


def test_every_exit_code_is_explained():
    found = {int(code) for code in re.findall(r"^\| `\w+` \| (\d+) \|", PAGES["errors.md"], re.M)}
    table = PAGES["errors.md"].partition("## Exceptions")[0]
    explained = {int(n) for codes in re.findall(r"^\| ([\d, ]+) \|", table, re.M) for n in codes.split(",")}
    assert explained == found | {0, 129, 130, 143}


def test_the_first_page_explains_the_words_of_messages():
    words = re.findall(r"^\| (?:\[([\w ]+)\]\(\S+\)|([\w ]+)) \|", PAGES["index.md"], flags=re.MULTILINE)
    assert {"cell", "content root", "lane", "root", "shard", "split"} <= {a or b for a, b in words}


def test_the_pages_show_every_command_and_no_other():
    blocks = re.findall(r"^```sh\n(.*?)^```$", "\n".join(PAGES.values()), flags=re.MULTILINE | re.DOTALL)
    shown = re.findall(r"^ibdata ([a-z]+)", "".join(blocks), flags=re.MULTILINE)
    assert set(shown) == set(cli.list_commands(None))
