"""`ibdata card` writes a card and a self-contained report, and the dataset stays valid."""

import os
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import pytest
from helpers.datasets import PLAIN
from helpers.folders import contents
from helpers.refusals import refused
from helpers.splits import BY_POLICY, HALVES

import ibdata
from ibdata.dataset import manifest
from ibdata.tools.card import card

slow = pytest.mark.slow


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return ibdata.generate(PLAIN, tmp_path_factory.mktemp("card") / "tiny", workers=1)


@pytest.fixture(scope="module")
def carded(plain, tmp_path_factory):
    folder = shutil.copytree(plain.path, tmp_path_factory.mktemp("carded") / "tiny")
    assert card(folder) == [folder / manifest.CARD, folder / manifest.REPORT]
    return ibdata.open(folder)


@slow
def test_a_card_and_a_report_are_new_and_the_dataset_is_the_same(plain, carded):
    """The card of a run has the measures of quality that need only the returns; this one has all."""
    before, after = (
        {str(Path(path).relative_to(made.path)): data for path, data in contents(made.path).items()}
        for made in (plain, carded)
    )
    own = {manifest.CARD, manifest.REPORT}
    assert before.keys() | own == after.keys()
    assert all(after[path] == data for path, data in before.items() if path not in own)
    assert b"| state action coverage |" in after[manifest.CARD]
    assert ibdata.validate(carded.path) == []


class Page(HTMLParser):
    """Tags, which are closed in order, and the texts of cells."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.cells = [], set(), []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.open += [tag] if tag not in ("meta", "img") else []

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.cells += [data] if self.open[-1:] == ["td"] else []


@slow
def test_the_report_is_whole_html_that_loads_nothing_and_says_what_the_dataset_is(carded):
    text = (carded.path / manifest.REPORT).read_text()
    page, cells = Page(text), Page(text).cells
    assert text.startswith("<!DOCTYPE html>\n")
    assert "://" not in text
    assert not page.tags & {"script", "link", "iframe", "object"}
    assert "default-src 'none'" in text
    assert len(re.findall('<img [^>]*src="data:image/png;base64,', text)) == text.count("<img") > 3
    reward = carded.statistics()["reward"]
    numbers = [*(reward[key] for key in ("mean", "std", "min", "max")), reward["quantiles"]["0.5"]]
    at = cells.index("reward") + 1
    assert [float(text) for text in cells[at : at + 5]] == pytest.approx(numbers, abs=1e-3)
    assert carded.content_root in text
    described = [column["description"] for column in carded.info["columns"]]
    paths = [shard["path"] for shard in carded.manifest["shards"]]
    words = [
        "240, in data/*.parquet",
        "12 of 20 steps",
        "random, safe",
        "source",
        *carded.manifest["versions"].values(),
    ]
    assert {*described, *paths, *words} <= set(cells)


def without_report(*arguments):
    raise ImportError("no matplotlib")


@pytest.mark.parametrize("name", [manifest.CARD, manifest.REPORT])
def test_an_edited_file_is_replaced_only_if_that_is_said(plain, tmp_path, monkeypatch, name):
    monkeypatch.setattr("ibdata.tools.card.page", lambda *arguments: b"a page")
    monkeypatch.setattr("ibdata.tools.card.drawn", lambda dataset: {})
    folder = Path(shutil.copytree(plain.path, tmp_path / "copied"))
    card(folder, overwrite=True)
    own = contents(folder)
    (folder / name).write_text("mine")
    edited = contents(folder)
    message = f"^{folder / name}: found other text than ibdata writes now; overwrite=True to replace it$"
    refused(message, card, folder)
    assert contents(folder) == edited
    card(folder, overwrite=True)
    assert contents(folder) == own
    card(folder)
    assert contents(folder) == own


def test_the_cards_of_generate_repair_and_split_are_replaced(plain, tmp_path, monkeypatch):
    monkeypatch.setattr("ibdata.tools.card.drawn", without_report)
    folder = Path(shutil.copytree(plain.path, tmp_path / "copied"))
    ibdata.split(folder, BY_POLICY)
    assert card(folder) == [folder / manifest.CARD]
    (folder / manifest.CARD).unlink()
    ibdata.repair(folder, workers=1)
    card(folder)
    ibdata.split(folder, HALVES)
    own = contents(folder)
    card(folder)
    assert contents(folder) == own


@slow
def test_without_matplotlib_only_the_card_is_written(ibdata, plain, carded, tmp_path):
    folder = Path(shutil.copytree(plain.path, tmp_path / "copied"))
    expected = contents(folder) | {str(folder / "README.md"): (carded.path / "README.md").read_bytes()}
    (folder / "README.md").unlink()
    (tmp_path / "matplotlib.py").write_text("raise ModuleNotFoundError('matplotlib')")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = ibdata("card", "copied", env={**os.environ, "PYTHONPATH": path})
    assert (done.returncode, done.stdout) == (0, "copied/README.md\n")
    assert done.stderr == (
        "ibdata: report.html is not written: ibdata.plots needs the package matplotlib: "
        "pip install matplotlib, or 'ibdata[plot]'\n"
    )
    assert contents(folder) == expected
