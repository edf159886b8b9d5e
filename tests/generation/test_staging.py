"""The folders `.next` and `.new`: only those with ibdata's mark are finished or removed; all else stays."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from helpers.tiny import FOUR_SHARDS

import ibdata
from ibdata.dataset import manifest
from ibdata.errors import IbdataError, UsageError
from ibdata.generation import receipt, replacement, staging
from ibdata.maintenance import rewrite

OTHER = FOUR_SHARDS.model_copy(update={"seed": 1})


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    return [ibdata.generate(e, folder / str(e.seed), workers=1) for e in (FOUR_SHARDS, OTHER)]


@pytest.fixture
def here(made, tmp_path, monkeypatch) -> Path:
    """A copy of a dataset, in the current folder, beside a copy of another."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(made[1].path, "other")
    return Path(shutil.copytree(made[0].path, "here"))


def contents(folder: Path) -> dict[str, bytes | None]:
    return {str(path): None if path.is_dir() else path.read_bytes() for path in folder.rglob("*")}


WRITERS = {
    "generate": lambda: ibdata.generate(OTHER, "here", workers=1),
    "resume": lambda: ibdata.generate(FOUR_SHARDS, "here", workers=1, resume=True),
    "overwrite": lambda: ibdata.generate(OTHER, "here", workers=1, overwrite=True),
    "shards": lambda: ibdata.generate_shards(FOUR_SHARDS, "1/1", "here", workers=1),
    "finalize": lambda: ibdata.finalize("here"),
    "repair": lambda: ibdata.repair("here"),
    "split": lambda: ibdata.split("here", scheme="leave-one-out"),
    "merge": lambda: ibdata.merge(["other", "third"], "here"),
}


@pytest.mark.parametrize("name", [manifest.NEXT, manifest.NEW])
@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
@pytest.mark.parametrize("within", ["a dataset", "a folder with notes", "a folder"])
def test_a_dataset_or_a_text_under_our_names_is_somebodys_and_stays(here, made, write, name, within):
    shutil.copytree("here", "third")
    if within != "a dataset":
        shutil.rmtree(here)
        here.mkdir()
    if within == "a folder with notes":
        (here / "notes.txt").write_text("mine")
    for mine in ("a dataset", "a card"):
        if mine == "a dataset":
            shutil.copytree(made[1].path, here / name)
        else:
            shutil.rmtree(here / name)
            (here / name).mkdir()
            (here / name / "README.md").write_text("mine")
        before = contents(here)
        with pytest.raises(IbdataError):
            write()
        assert contents(here) == before


@pytest.mark.parametrize("name", [manifest.NEXT, manifest.NEW])
def test_what_is_not_ours_is_named(here, name):
    (here / name).mkdir()
    (here / name / "report.html").write_text("mine")
    for write in (WRITERS["overwrite"], WRITERS["repair"]):
        with pytest.raises(UsageError, match=rf"here/\{name}: found something that ibdata did not write"):
            write()
    assert ibdata.validate(here) == []


@pytest.mark.parametrize("path", ["thesis.txt", "data/thesis.txt", "meta/notes/a.txt", "more/README.md"])
def test_a_file_of_somebody_beside_ours_is_named_before_anything_is_removed(here, path):
    staging.make(here / ".next")
    for own in ("data/part-00000-01234567.parquet", f"meta/{manifest.FRESH}", path):
        (here / ".next" / own).parent.mkdir(parents=True, exist_ok=True)
        (here / ".next" / own).write_text("x")
    before = contents(here)
    with pytest.raises(UsageError, match=r"found something that ibdata did not write; move it away"):
        WRITERS["overwrite"]()
    assert contents(here) == before


def test_a_users_files_beside_an_unfinished_run_stay(here):
    (here / manifest.PATH).unlink()
    (here / receipt.FOLDER).mkdir()
    (here / staging.EXPERIMENT).write_text("of another run")
    for name in (manifest.CARD, manifest.REPORT):
        (here / name).write_text("mine")
    with pytest.raises(UsageError, match=r"README\.md: found a text that ibdata did not write"):
        WRITERS["overwrite"]()
    (here / manifest.CARD).unlink()
    WRITERS["overwrite"]()
    assert (here / manifest.REPORT).read_text() == "mine"


def test_what_a_full_disk_left_in_the_place_of_a_replaced_folder_is_ours(here):
    (here / ".next/data").mkdir(parents=True)
    for text in (b"", manifest.BAR[:9], manifest.BAR):
        (here / ".next/data" / manifest.REPLACED).write_bytes(text)
        assert ibdata.repair(here) == []
    WRITERS["overwrite"]()
    (here / ".next/data" / manifest.REPLACED).write_bytes(b"x" * 100)
    with pytest.raises(UsageError, match=r"\.next: found something that ibdata did not write"):
        WRITERS["overwrite"]()


@pytest.mark.parametrize("name", [manifest.NEXT, manifest.NEW])
def test_our_names_cannot_be_an_output(here, name):
    before = contents(Path())
    for write in (
        lambda: ibdata.generate(FOUR_SHARDS, name, workers=1),
        lambda: ibdata.generate_shards(FOUR_SHARDS, "1/1", f"a/{name}", workers=1),
        lambda: ibdata.merge(["here", "other"], name),
        lambda: ibdata.split("here", scheme="leave-one-out", materialize=name),
        lambda: ibdata.export("here", to="npz", out=name),
    ):
        with pytest.raises(UsageError, match=rf"found the name \{name}, which is kept for replacing"):
            write()
    assert contents(Path()) == before


@pytest.mark.parametrize("inside", ["both/data", "both/.next/data", "both/more"])
def test_an_output_inside_the_folder_of_a_merge_is_refused_while_it_is_made(here, monkeypatch, inside):
    copied = rewrite._copied

    def meanwhile(*args):
        with pytest.raises(UsageError, match=r"lies within the dataset .*both; choose a place outside"):
            ibdata.generate(FOUR_SHARDS, inside, workers=1)
        return copied(*args)

    monkeypatch.setattr(rewrite, "_copied", meanwhile)
    merged = ibdata.merge(["here", "other"], "both")
    assert ibdata.validate(merged.path) == []
    assert pq.read_table("both/data").num_rows == 40


def test_temporary_files_with_names_of_somebodys_stay(tmp_path):
    (tmp_path / "out").mkdir()
    for name in (".tmp-mine", ".tmp-0123456789ab", ".tmp-zz3456789abc-notes.part"):
        (tmp_path / "out" / name).write_text("mine")
    before = contents(tmp_path)
    ibdata.generate(FOUR_SHARDS, tmp_path / "out", workers=1)
    assert before.items() <= contents(tmp_path).items()


@pytest.mark.parametrize("name", [".part-00000-aaaaaaaa.parquet", ".Part.PARQUET", ".h"])
def test_hidden_parquet_and_folders_in_data_are_not_taken_along(here, name):
    if name == ".h":
        (here / "data" / name).mkdir()
    else:
        shutil.copy(next(Path("other/data").iterdir()), here / "data" / name)
    before = contents(here)
    with pytest.raises(UsageError, match=r"found a (file|folder) that is not the dataset's; move it away"):
        WRITERS["overwrite"]()
    assert contents(here) == before


@pytest.mark.slow
@pytest.mark.parametrize("prefix", [".nfs", ".fuse_hidden"])
def test_open_files_on_a_network_are_left_for_the_next_time(here, monkeypatch, prefix):
    """As on NFS, where an open file that is removed gets another name, and its folder stays."""
    remove, place = Path.unlink, here.absolute()

    def unlink(path, missing_ok=False):
        if path.parent.name == "data" and path.name.startswith("part-00003") and path.exists():
            path.rename(path.with_name(f"{prefix}{path.name[-16:-8]}"))
        elif not path.name.startswith(prefix):
            remove(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", unlink)
    for seed in (1, 2, 3):
        experiment = FOUR_SHARDS.model_copy(update={"seed": seed})
        replaced = ibdata.generate(experiment, here, workers=1, overwrite=True)
        assert ibdata.validate(here) == []
        assert sorted(path.name for path in (here / "data").iterdir()) == sorted(
            Path(shard["path"]).name for shard in replaced.manifest["shards"]
        )
    ibdata.split(here, scheme="leave-one-out")
    assert len(list(here.glob(f".next/old-*/{prefix}*"))) == 3
    monkeypatch.undo()
    for busy in place.glob(f".next/*/{prefix}*"):
        busy.unlink()
    ibdata.generate(OTHER, place, workers=1, overwrite=True)
    assert [str(path.relative_to(place)) for path in place.glob(".next/*/*")] == [".next/data/replaced"]


def refusing(part: str, code: int, function):
    """A function that moves folders, but for one that the system would not move from the dataset."""

    def move(path, other):
        if Path(other if function.__name__ == "exchanged" else path) == Path("here", part):
            raise OSError(code, os.strerror(code))
        return function(path, other)

    return move


@pytest.mark.parametrize("part", ["data", "meta"])
@pytest.mark.parametrize("code", [errno.EACCES, errno.EBUSY])
def test_a_folder_that_cannot_be_moved_is_named_before_the_other_has_been(here, monkeypatch, part, code):
    def exchange(*_):
        raise AssertionError("exchanged")

    before = contents(here)
    monkeypatch.setattr(replacement, "exchanged", exchange)
    monkeypatch.setattr(Path, "rename", refusing(part, code, Path.rename))
    with pytest.raises(IbdataError, match=f"here: cannot be written: {part}: {os.strerror(code)}"):
        WRITERS["overwrite"]()
    assert contents(here) == before


@pytest.mark.parametrize("exchange", [True, False])
def test_data_go_back_to_their_place_if_the_metadata_cannot_be_moved(here, monkeypatch, exchange):
    """The system lets them move when it is asked, and not a moment later."""
    before = contents(here)
    looked = []

    def look(seconds):  # who has listed the new folder finds a file there that cannot be read
        barred = [path for path in (here / "data").iterdir() if path.read_bytes() == manifest.BAR]
        assert [str(path) in before for path in barred] == [False]
        looked.append(seconds)

    monkeypatch.setattr(replacement.time, "sleep", look)
    monkeypatch.setattr(replacement, "refuse_immovable", lambda folder, full: None)
    if exchange:
        monkeypatch.setattr(replacement, "exchanged", refusing("meta", errno.EBUSY, replacement.exchanged))
    else:
        monkeypatch.setattr(replacement, "exchanged", lambda a, b: False)
        monkeypatch.setattr(Path, "rename", refusing("meta", errno.EBUSY, Path.rename))
    with pytest.raises(IbdataError, match="here: cannot be written: meta: Device or resource busy"):
        WRITERS["overwrite"]()
    assert contents(here) == before
    assert ibdata.validate(here) == []
    assert looked == [replacement.PAUSE]
