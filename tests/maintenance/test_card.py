"""`ibdata card` writes a card and a self-contained report, and the dataset stays valid."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment
from ibdata.dataset import manifest
from ibdata.errors import BusyError, DatasetError, UsageError
from ibdata.generation import staging
from ibdata.plots import drawn, plots
from ibdata.report import card
from ibdata.system import lock
from ibdata.validation.validate import validate

pytestmark = pytest.mark.slow

PLAIN = {
    "name": "tiny",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "random"}, {"kind": "constant", "action": [0, 0, 0], "name": "still"}],
    "episodes": 3,
    "steps": 20,
    "output": {"shard_rows": 60},
    "splits": {"source": {"setpoint": 20}},
}
VOID = {"meta", "img"}


class Page(HTMLParser):
    """Elements that are closed in order, their attributes, and the text of each kind."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: list[tuple[str, str, str | None]] = []
        self.texts: dict[str, list[str]] = {}
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.attributes += [(tag, name, value) for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open:
            self.texts.setdefault(self.open[-1], []).append(data)

    def all(self, tag, name):
        return [value for t, n, value in self.attributes if (t, n) == (tag, name)]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    folder = tmp_path_factory.mktemp("card") / "tiny"
    return ibdata.generate(Experiment.model_validate(PLAIN), folder, workers=1)


@pytest.fixture(scope="module")
def carded(plain, tmp_path_factory):
    return card(shutil.copytree(plain.path, tmp_path_factory.mktemp("carded") / "tiny"))


@pytest.fixture
def copied(carded, tmp_path) -> Path:
    return Path(shutil.copytree(carded.path, tmp_path / "copied"))


def test_only_the_report_and_the_manifest_change_and_the_dataset_is_valid(plain, carded):
    before, after = contents(plain.path), contents(carded.path)
    changed = {path for path in after if before.get(path) != after[path]}
    assert changed == {manifest.REPORT, manifest.PATH}
    assert set(before) <= set(after)
    assert ibdata.validate(carded.path) == []
    assert carded.content_root == plain.content_root
    keep = [key for key in plain.manifest if key not in ("files", "checksum")]
    assert {key: carded.manifest[key] for key in keep} == {key: plain.manifest[key] for key in keep}


def test_the_card_is_written_anew_and_the_same_dataset_gets_the_same_bytes(copied):
    before = contents(copied)
    (copied / "README.md").unlink()
    card(copied)
    assert contents(copied) == before


def test_a_text_of_somebody_in_the_place_of_the_card_stays(copied):
    (copied / "README.md").write_text("mine")
    before = contents(copied)
    with pytest.raises(UsageError, match=r"README\.md: found a text that ibdata did not write; move it away"):
        card(copied)
    assert contents(copied) == before


def test_the_report_is_whole_html_that_loads_nothing(carded):
    text = (carded.path / manifest.REPORT).read_text()
    page = Page(text)
    assert text.startswith("<!DOCTYPE html>\n")
    assert "://" not in text
    assert {name for _, name, _ in page.attributes} & {"srcset", "onload", "action", "data"} == set()
    assert not {tag for tag, *_ in page.attributes} & {"script", "link", "iframe", "object"}
    assert all(value.startswith("data:image/png;base64,") for value in page.all("img", "src"))
    assert page.all("html", "lang") == ["en"]
    assert any("default-src 'none'" in value for value in page.all("meta", "content"))
    assert any("width=device-width" in value for value in page.all("meta", "content"))


def test_the_report_has_the_pictures_and_names_each(carded):
    page = Page((carded.path / manifest.REPORT).read_text())
    shown = {base64.b64decode(value.partition(",")[2]) for value in page.all("img", "src")}
    assert shown == set(drawn(carded).values())
    assert len(shown) == len(plots()) == len(set(page.all("img", "alt")))


def test_links_stay_in_the_page_and_reach_each_section_and_each_enlarged_picture(carded):
    page = Page((carded.path / manifest.REPORT).read_text())
    ids = [value for _, name, value in page.attributes if name == "id"]
    assert len(ids) == len(set(ids))
    links = page.all("a", "href")
    assert {link.removeprefix("#") for link in links} <= set(ids)
    assert set(page.all("h2", "id")) <= {link.removeprefix("#") for link in links}
    assert {f"#large-{name}" for name in plots()} <= set(links)


def test_the_report_has_the_returns_and_the_scores(plain, tmp_path):
    longer = Experiment.model_validate({**PLAIN, "episodes": 2, "steps": 1000})
    dataset = card(ibdata.generate(longer, tmp_path / "longer", workers=1).path)
    found = dataset.returns()
    page = Page((dataset.path / manifest.REPORT).read_text())
    cells = page.texts["td"]
    for result in found["results"]:
        row = [result["policy"], f"{result['setpoint']:g}", str(result["episodes"])]
        row += [f"{result[key]:.6g}" for key in ("mean_return", "standard_error", "mean_reward")]
        row.append("–" if result["score"] is None else f"{round(result['score'], 1):.6g}")
        assert row in [cells[at : at + 7] for at in range(len(cells))]
    assert f"score: {found['scale']}" in page.texts["p"]


def test_the_report_has_the_quality_of_the_data(plain, carded):
    cells = Page((carded.path / manifest.REPORT).read_text()).texts["td"]
    table, *_ = ibdata.quality(plain).tables()
    for name, value, meaning in table.rows:
        row = [name, "–" if value is None else f"{value:.6g}", meaning]
        assert row in [cells[at : at + 3] for at in range(len(cells))]


def test_without_matplotlib_the_card_is_written_and_a_line_says_what_to_install(ibdata, plain, tmp_path):
    folder = Path(shutil.copytree(plain.path, tmp_path / "copied"))
    before = contents(folder)
    (folder / "README.md").unlink()
    (tmp_path / "matplotlib.py").write_text("raise ModuleNotFoundError('matplotlib')")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = ibdata("card", "copied", env={**os.environ, "PYTHONPATH": path})
    assert (done.returncode, done.stdout) == (0, "copied/README.md\n")
    assert done.stderr == (
        "ibdata: report.html is not written: ibdata.plots needs the package matplotlib: "
        "pip install matplotlib, or 'ibdata[plot]'\n"
    )
    assert contents(folder) == before
    assert validate(folder) == []


def test_the_report_says_what_the_dataset_is(carded):
    page = Page((carded.path / manifest.REPORT).read_text())
    cells, code = page.texts["td"], "".join(page.texts["code"])
    reward = carded.statistics()["reward"]
    at = cells.index("reward")
    numbers = [*(reward[key] for key in ("mean", "std", "min", "max")), reward["quantiles"]["0.5"]]
    assert cells[at + 1 : at + 6] == [f"{x:.6g}" for x in numbers]
    assert (carded.path / manifest.EXPERIMENT).read_text() in code
    assert carded.content_root in code
    for column in carded.info["columns"]:
        assert column["description"] in cells
    for shard in carded.manifest["shards"]:
        assert shard["path"] in cells
    for value in ("240", "12 of 20 steps", "random, still", "source", *carded.manifest["versions"].values()):
        assert value in cells


def test_what_it_says_of_loading_is_true(carded):
    code = next(
        text for text in Page((carded.path / manifest.REPORT).read_text()).texts["code"] if "import" in text
    )
    done = subprocess.run([sys.executable, "-c", f"{code}\nprint(len(data), len(ds))"], cwd=carded.path,
                          capture_output=True, text=True, check=True)  # fmt: skip
    assert done.stdout == "240 240\n"


def test_texts_of_a_dataset_cannot_become_elements(copied, sign):
    info = json.loads((copied / "meta/dataset.json").read_text())
    info["columns"][0]["description"] = "<script>alert('\"')</script> & more"
    (copied / "meta/dataset.json").write_text(json.dumps(info))
    sign(copied, "meta/dataset.json")
    page = Page((card(copied).path / manifest.REPORT).read_text())
    assert info["columns"][0]["description"] in "".join(page.texts["td"])
    assert "script" not in page.texts


def test_the_command_prints_the_files(ibdata, copied):
    done = ibdata("card", str(copied))
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{copied}/README.md\n{copied}/report.html\n"
    said = json.loads(ibdata("card", str(copied), "--json").stdout)
    assert said["files"] == ["README.md", "report.html"]


@pytest.mark.parametrize("how", ["missing", "changed"])
def test_a_damaged_report_is_taken_away_by_repair_and_can_be_made_again(ibdata, carded, copied, how):
    report = copied / manifest.REPORT
    report.unlink() if how == "missing" else report.write_text("<p>else")
    assert [problem.path for problem in validate(copied)] == [manifest.REPORT]
    done = ibdata("repair", str(copied))
    assert f"removed report.html; ibdata card {copied} makes it again\n" in done.stdout
    assert not report.exists()
    assert validate(copied) == []
    card(copied)
    edited = {"report-edited.html": b"<p>else"} if how == "changed" else {}  # somebody's text is kept
    assert contents(copied) == contents(carded.path) | edited


def test_other_files_are_repaired_and_the_report_stays(carded, copied, shard_file):
    for path in ("README.md", "meta/statistics.json", shard_file(copied, 1)):
        (copied / path).unlink()
    ibdata.repair(copied, workers=1)
    assert contents(copied) == contents(carded.path)


def test_without_its_manifest_a_dataset_is_repaired_without_a_report(copied):
    """Nobody can tell whose report.html is: it stays, and is none of the dataset's files any more."""
    report = (copied / manifest.REPORT).read_bytes()
    (copied / manifest.PATH).unlink()
    ibdata.repair(copied, workers=1)
    assert manifest.REPORT not in [file["path"] for file in ibdata.open(copied).manifest["files"]]
    assert (copied / manifest.REPORT).read_bytes() == report
    assert ibdata.validate(copied) == []


def test_new_splits_take_the_report_away(copied):
    split = ibdata.split(copied, "policy")
    assert not (copied / manifest.REPORT).exists()
    assert ibdata.validate(copied) == []
    assert "still" in Page((card(copied).path / manifest.REPORT).read_text()).texts["td"]
    assert list(split.splits) == ["source", "random", "still"]


def test_copies_have_no_report(copied, plain, tmp_path):
    files = ibdata.split(copied, "policy", materialize=tmp_path / "files")
    other = ibdata.generate(Experiment.model_validate({**PLAIN, "seed": 1}), tmp_path / "other", workers=1)
    both = ibdata.merge([copied, other.path], tmp_path / "both")
    for made in (files, both):
        assert not (made.path / manifest.REPORT).exists()
        card(made.path)
        assert ibdata.validate(made.path) == []


def test_overwriting_a_dataset_takes_the_report_away(copied):
    ibdata.generate(Experiment.model_validate(PLAIN), copied, workers=1, overwrite=True)
    assert not (copied / manifest.REPORT).exists()
    assert ibdata.validate(copied) == []


def test_a_dataset_that_cannot_be_carded_stays_as_it_is(copied, monkeypatch):
    before = contents(copied)
    with lock.locked(copied), pytest.raises(BusyError):
        card(copied)

    def fail(*_, **__):
        raise RuntimeError("full")

    monkeypatch.setattr("ibdata.maintenance.card.rewritten_manifest", fail)
    with pytest.raises(RuntimeError):
        card(copied)
    assert contents(copied) == before
    with pytest.raises(DatasetError, match="no finished dataset here"):
        card(copied / "meta")


def test_what_a_killed_run_left_is_taken_away(carded, copied):
    staging.make(copied / manifest.NEXT)
    for name in (manifest.CARD, manifest.REPORT):
        shutil.copy(copied / name, copied / manifest.NEXT)
        (copied / manifest.NEXT / f".tmp-123456789abc-{name}.part").write_text("half")
    card(copied)
    assert contents(copied) == contents(carded.path)


def test_a_dataset_that_changes_meanwhile_is_left_alone(copied, monkeypatch):
    def draw(dataset):
        pictures = drawn(dataset)
        ibdata.split(copied, "policy")
        return pictures

    monkeypatch.setattr("ibdata.maintenance.card.drawn", draw)
    with pytest.raises(manifest.ReplacedError, match="replaced while it was read; open it again"):
        card(copied)
    assert ibdata.validate(copied) == []


def test_a_report_that_ibdata_did_not_write_stays(plain, tmp_path):
    folder = Path(shutil.copytree(plain.path, tmp_path / "copied"))
    (folder / "report.html").write_text("mine")
    with pytest.raises(UsageError, match=r"report\.html: found a file that ibdata did not write"):
        card(folder)
    assert (folder / "report.html").read_text() == "mine"
