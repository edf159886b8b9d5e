"""A card or report that somebody has edited is not lost, whatever command would replace it."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment
from ibdata.dataset import manifest
from ibdata.errors import UsageError
from ibdata.generation import replacement, single_files
from ibdata.maintenance.card import card
from ibdata.writing.card import has_other_text
from ibdata.writing.metadata import as_json

PLAIN = Experiment.model_validate(
    {"name": "tiny", "setpoints": [20, 70], "policies": [{"kind": "random"}], "episodes": 2, "steps": 5,
     "splits": {"source": {"setpoint": 20}}}
)  # fmt: skip
NOTES = b"\n## My notes\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return ibdata.generate(PLAIN, tmp_path_factory.mktemp("made") / "tiny", workers=1)


@pytest.fixture
def here(made, tmp_path, monkeypatch) -> Path:
    """A copy of the dataset, in the current folder, with a report."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ibdata.maintenance.card._report", lambda *_: None)
    folder = Path(shutil.copytree(made.path, "here"))
    (folder / manifest.REPORT).write_bytes(b"<p>")
    listed = json.loads((folder / manifest.PATH).read_bytes())
    entry = {"path": manifest.REPORT, "bytes": 3, "sha256": hashlib.sha256(b"<p>").hexdigest()}
    listed["files"].append(entry)
    listed["checksum"] = manifest.checksum(listed)
    (folder / manifest.PATH).write_bytes(as_json(listed))
    assert ibdata.validate(folder) == []
    return folder


def contents(folder: Path) -> dict[Path, bytes]:
    return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def edit(path: Path) -> bytes:
    text = path.read_bytes() + NOTES
    path.write_bytes(text)
    return text


WRITERS = {
    "overwrite": lambda: ibdata.generate(PLAIN, "here", workers=1, overwrite=True),
    "card": lambda: card("here"),
    "split": lambda: ibdata.split("here", by="episode", fractions=(0.5, 0.5)),
}


@pytest.mark.parametrize("name", [manifest.CARD, manifest.REPORT])
@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_an_edited_file_is_named_and_left(here, write, name):
    edit(here / name)
    before = contents(here)
    with pytest.raises(UsageError, match=f"here/{name}: was edited, and the new .* move it away first"):
        write()
    assert contents(here) == before
    (here / name).unlink()
    write()
    assert not (here / manifest.CARD).read_bytes().endswith(NOTES)


@pytest.mark.parametrize("lost", [None, manifest.PATH])
@pytest.mark.parametrize("own", [False, True])
def test_repair_makes_the_card_again_and_keeps_the_edited_one_beside_it(here, capsys, lost, own):
    made, card = (here / "README.md").read_bytes(), here / "README.md"
    if own:
        card.write_bytes(b"mine")
    text = card.read_bytes() if own else edit(card)
    if lost:
        (here / lost).unlink()
    assert ibdata.repair(here, workers=1) == [lost or manifest.CARD]
    assert card.read_bytes() == made
    assert (here / "README-edited.md").read_bytes() == text
    assert ibdata.validate(here) == []
    assert capsys.readouterr().err == (
        "ibdata: here/README.md: found a text that ibdata did not write; it is now in README-edited.md\n"
    )


def test_texts_that_were_kept_are_not_kept_again_and_not_overwritten(here):
    for text in (b"one", b"one", b"two"):
        (here / "README.md").write_bytes(text)
        ibdata.repair(here, workers=1)
    assert {path.name: path.read_bytes() for path in here.glob("README-*")} == {
        "README-edited.md": b"one",
        "README-edited-2.md": b"two",
    }


@pytest.mark.parametrize("name", [manifest.CARD, manifest.REPORT])
def test_what_is_edited_while_a_replacement_is_interrupted_is_kept(here, monkeypatch, name):
    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(replacement, "place_single_files", killed)
        with pytest.raises(KeyboardInterrupt):
            WRITERS["overwrite"]()
    text = edit(here / name)
    ibdata.repair(here, workers=1)
    assert (here / name.replace(".", "-edited.")).read_bytes() == text
    assert ibdata.validate(here) == []


def test_a_link_in_the_place_of_the_card_is_replaced_and_leads_to_what_it_led_to(here):
    Path("mine.md").write_bytes(b"mine")
    (here / "README.md").unlink()
    (here / "README.md").symlink_to("../mine.md")
    ibdata.repair(here, workers=1)
    assert ibdata.validate(here) == []
    assert Path("mine.md").read_bytes() == b"mine"
    assert not (here / "README-edited.md").exists()


@pytest.mark.parametrize(
    ("found", "own"),
    [
        (b"", False),
        (b"a card: part-00000-0a1b2c3d.pa", False),
        (b"a carp: part-00000-0a1b2c3d.parquet", True),
        (b"a cazd: part-00000-0a1b2c3d.parquet", False),
        (b"a card: part-00000-ffffffff.parquet", False),
        (b"a card: part-00001-0a1b2c3d.parquet", False),
        (b"a card: part-00000-ffffffff.parquet and more", True),
        (b"mine", True),
    ],
)
def test_what_is_cut_or_has_a_flipped_bit_is_no_text_of_somebody(found, own):
    assert has_other_text(found, b"a card: part-00000-0a1b2c3d.parquet") is own


def test_a_card_that_cannot_be_read_is_kept_under_another_name(here, capsys, monkeypatch):
    text = edit(here / manifest.CARD)
    real = single_files.file_sha256

    def unreadable(path):
        return None if path == here / manifest.CARD else real(path)

    with monkeypatch.context() as denied:
        for module in ("generation.single_files", "validation.files"):
            denied.setattr(f"ibdata.{module}.file_sha256", unreadable)
        assert ibdata.repair(here, workers=1) == [manifest.CARD]
    assert (here / "README-edited.md").read_bytes() == text
    assert "it is now in README-edited.md" in capsys.readouterr().err
    assert ibdata.validate(here) == []


def test_what_somebody_puts_into_data_during_a_replacement_is_moved_beside_it(here, capsys, monkeypatch):
    commit = replacement.commit

    def late(folder):
        for name in ("mine.csv", ".hidden"):
            (here / "data" / name).write_text(name)
        commit(folder)

    monkeypatch.setattr(replacement, "commit", late)
    for found in ("moved-mine.csv", "moved-2-mine.csv"):
        made = ibdata.generate(PLAIN, "here", overrides=["steps=6"], workers=1, overwrite=True)
        assert made.info["counts"]["steps"] == 6
        assert (here / found).read_text() == "mine.csv"
        assert f"is not of the dataset; it is now here/{found}" in capsys.readouterr().err
        assert (here / "data" / ".hidden").read_text() == ".hidden"
        assert ibdata.validate(here) == []
