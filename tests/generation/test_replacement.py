"""Replacing a dataset: leftovers of killed writers, files of users, and refusals."""

from __future__ import annotations

import errno
import json
import os
import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import ibdata
from ibdata import Experiment
from ibdata.dataset import manifest
from ibdata.errors import DatasetError, IbdataError, UsageError
from ibdata.generation import replacement, staging
from ibdata.report import card

PLAIN = {
    "name": "tiny",
    "setpoints": 50.0,
    "policies": [{"kind": "random"}, {"kind": "safe"}],
    "episodes": 2,
    "steps": 5,
    "output": {"shard_rows": 5},
}


def described(**changes) -> Experiment:
    return Experiment.model_validate({**PLAIN, **changes})


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    return {seed: ibdata.generate(described(seed=seed), folder / str(seed), workers=1) for seed in (0, 1)}


@pytest.fixture
def here(made, tmp_path, monkeypatch) -> Path:
    """A copy of the dataset of seed 0, in the current folder."""
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copytree(made[0].path, "here"))


def names(folder: Path) -> set[str]:
    """The files of a folder, but the one that a replacement leaves in the old folder."""
    files = {path for path in folder.rglob("*") if path.is_file() and path.name != manifest.REPLACED}
    return {str(path.relative_to(folder)) for path in files}


def rules(folder: Path) -> set[str]:
    return {problem.rule for problem in ibdata.validate(folder)}


def test_no_two_runs_give_a_file_the_same_name(here, made):
    old = {shard["path"] for shard in made[0].manifest["shards"]}
    new = {shard["path"] for shard in made[1].manifest["shards"]}
    assert len(old) == len(new) == 4
    assert old & new == set()
    again = ibdata.generate(described(), here, workers=1, overwrite=True)
    newer = {shard["path"] for shard in again.manifest["shards"]}
    assert newer & (old | new) == set()
    assert {name for name in names(here) if name.startswith("data/")} == newer
    assert again.content_root == made[0].content_root


MINE = ("data/.gitattributes", "meta/notes.txt", "meta/experiment-mine.yaml", "notes.txt", "report.html")


@pytest.mark.parametrize("exchange", [True, False])
def test_what_a_user_has_put_beside_the_files_stays(here, monkeypatch, exchange):
    if not exchange:
        monkeypatch.setattr(replacement, "exchanged", lambda a, b: False)
    for path in MINE:
        (here / path).write_text("mine")
    replaced = ibdata.generate(described(seed=1), here, workers=1, overwrite=True)
    assert ibdata.validate(here) == []
    for path in MINE:
        assert (here / path).read_text() == "mine"
    assert len(names(here)) == len(replaced.manifest["files"]) + 1 + len(MINE)


def test_a_reader_that_has_listed_the_old_folder_looks_for_a_file_that_is_there_and_cannot_be_read(
    here, monkeypatch
):
    old = os.listdir(here / "data")
    looked = []

    def look(seconds):  # pyarrow drops the names that it does not find
        found = [name for name in old if (here / "data" / name).exists()]
        for path in (here / "data", here / "data" / found[0]):
            with pytest.raises(pa.ArrowInvalid, match="Parquet magic bytes not found"):
                pq.read_table(path)
        looked.append(seconds)

    monkeypatch.setattr(replacement.time, "sleep", look)
    ibdata.generate(described(seed=1), here, workers=1, overwrite=True)
    assert looked == [replacement.PAUSE]
    assert pq.read_table(here / "data").num_rows == 20
    assert rules(here) == set()


@pytest.mark.parametrize("exchange", [True, False])
def test_a_reader_in_the_old_folder_does_not_find_it_empty(here, monkeypatch, exchange):
    if not exchange:
        monkeypatch.setattr(replacement, "exchanged", lambda a, b: False)
    opened = os.open(here / "data", os.O_RDONLY)
    ibdata.generate(described(seed=1), here, workers=1, overwrite=True)
    assert os.listdir(opened) == [manifest.REPLACED]
    with pytest.raises(pa.ArrowInvalid, match="Parquet magic bytes not found"):
        pq.read_table(f"/proc/self/fd/{opened}")
    os.close(opened)
    assert sum(pq.read_table(path).num_rows for path in here.rglob("part-*.parquet")) == 20
    ibdata.generate(described(seed=2), here, workers=1, overwrite=True)
    assert [path.name for path in here.glob(".next/*/*")] == [manifest.REPLACED]


def test_links_where_a_replacement_writes_lead_nowhere(here, tmp_path):
    victim = tmp_path / "victim"
    victim.mkdir()
    (victim / "part-00000-00000000.parquet").write_text("mine")
    staging.make(here / ".new")
    (here / ".new/old-data").symlink_to(victim)
    with pytest.raises(UsageError, match=r"\.new/old-data: found a link, expected a folder; remove it"):
        ibdata.repair(here)
    (here / ".new/old-data").unlink()
    shutil.copytree(here / "data", here / ".new/data")
    (here / ".new/data" / manifest.REPLACED).symlink_to(victim / "part-00000-00000000.parquet")
    ibdata.repair(here)
    assert [path.read_text() for path in victim.iterdir()] == ["mine"]
    assert ibdata.validate(here) == []


def test_pipes_in_the_place_of_shards_are_replaced(here):
    for path in (here / "data").iterdir():
        path.unlink()
        os.mkfifo(path)
    ibdata.generate(described(seed=1), here, workers=1, overwrite=True)
    assert ibdata.validate(here) == []


def test_marks_of_a_copy_of_an_unsettled_folder_do_not_mislead(here, made, monkeypatch):
    for part in ("data", "meta"):
        (here / part / manifest.FRESH).touch()
    swap = replacement._swap

    def killed(new, folder, part):
        if part == "meta":
            raise KeyboardInterrupt
        swap(new, folder, part)

    monkeypatch.setattr(replacement, "_swap", killed)
    with pytest.raises(KeyboardInterrupt):
        ibdata.generate(described(seed=1), here, workers=1, overwrite=True)
    monkeypatch.setattr(replacement, "_swap", swap)
    ibdata.repair(here)
    assert ibdata.validate(here) == []
    assert ibdata.open(here).content_root == made[1].content_root


def test_ranges_of_another_experiment_are_not_made_where_a_replacement_was_interrupted(here):
    (here / ".new").mkdir()
    for call in (
        lambda: ibdata.generate_shards(described(seed=7), "1/1", here),
        lambda: ibdata.finalize(here),
    ):
        with pytest.raises(UsageError, match="a replacement was interrupted here; ibdata repair here"):
            call()


def test_an_empty_folder_of_somebody_is_named_and_left(here):
    (here / ".next/keep").mkdir(parents=True)
    with pytest.raises(UsageError, match=r"here/\.next/keep: found something that ibdata did not write"):
        ibdata.generate(described(seed=1), here, workers=1, overwrite=True)
    assert (here / ".next/keep").is_dir()


def test_a_dataset_opened_before_is_read_or_said_to_be_replaced(here):
    before = ibdata.open(here)
    ibdata.generate(described(seed=1), here, workers=1, overwrite=True)
    for read in (
        lambda d: d.table(),
        lambda d: d.to_pandas(),
        lambda d: d.episodes,
        lambda d: d.statistics(),
        lambda d: list(d.iter_batches()),
    ):
        with pytest.raises(IbdataError, match="here: replaced while it was read; open it again") as error:
            read(before)
        assert error.value.exit_code == 75
    assert len(ibdata.open(here).table()) == 20


def test_labels_made_later_are_not_mixed_with_those_before(here):
    before = ibdata.open(here)
    ibdata.split(here, by="policy")
    assert len(before.table()) == 20  # the rows are the same
    with pytest.raises(IbdataError, match="replaced while it was read"):
        before.statistics()
    assert set(ibdata.open(here).splits) == {"random", "safe"}


def test_a_folder_that_does_not_count_is_not_believed_and_goes(here, made):
    shutil.copytree(made[1].path / "data", here / ".new/data")
    staging.make(here / ".new")
    assert ibdata.open(here).table() == made[0].table()
    assert ibdata.repair(here) == []
    assert ibdata.validate(here) == []
    assert not (here / ".new").exists()


@pytest.mark.parametrize("mark", ["meta", "data"])
def test_a_folder_that_is_not_whole_does_not_count(here, made, mark):
    for part in ("data", "meta"):
        shutil.copytree(made[1].path / part, here / ".new" / part)
    staging.make(here / ".new")
    (here / ".new" / mark / manifest.FRESH).touch()
    next((here / ".new/data").iterdir()).unlink()
    assert ibdata.repair(here) == []
    assert ibdata.open(here).content_root == made[0].content_root
    assert ibdata.validate(here) == []


def test_what_ibdata_did_not_write_is_named_and_left(here):
    staging.make(here / ".new")
    (here / ".new/thesis.txt").write_text("mine")
    for write in (
        lambda: ibdata.repair(here),
        lambda: ibdata.split(here, by="policy"),
        lambda: ibdata.generate(described(seed=1), here, workers=1, overwrite=True),
    ):
        with pytest.raises(UsageError, match=r"thesis\.txt: found something that ibdata did not write; move"):
            write()
    assert next(here.rglob("thesis.txt")).read_text() == "mine"
    next(here.rglob("thesis.txt")).unlink()
    ibdata.repair(here)
    assert ibdata.validate(here) == []


OUTPUTS = {
    "generate": lambda out: ibdata.generate(described(), out, workers=1),
    "shards": lambda out: ibdata.generate_shards(described(), "1/1", out, workers=1),
    "estimate": lambda out: ibdata.estimate(described(), out),
    "merge": lambda out: ibdata.merge(["here", "other"], out),
    "split": lambda out: ibdata.split("here", by="policy", materialize=out),
    "export": lambda out: ibdata.export("other", to="npz", out=out),
}


@pytest.mark.parametrize("write", OUTPUTS.values(), ids=OUTPUTS)
@pytest.mark.parametrize("place", ["here/data/more", "here/.new", "here/more", "here/meta/a/b", "link/x"])
def test_an_output_inside_a_dataset_is_refused(here, made, write, place):
    shutil.copytree(made[1].path, "other")
    Path("link").symlink_to("here/data")
    before = names(here)
    with pytest.raises(UsageError, match=r"lies within the dataset .*here; choose a place outside"):
        write(place)
    assert names(here) == before
    assert ibdata.validate(here) == []


@pytest.mark.parametrize("write", OUTPUTS.values(), ids=OUTPUTS)
def test_an_output_in_a_folder_that_looks_like_a_column_is_refused(here, made, write):
    """DuckDB takes the values of such a column from the path."""
    shutil.copytree(made[1].path, "other")
    with pytest.raises(UsageError, match=r"found the folder policy=safe, .*; choose another name"):
        write("runs/policy=safe")


def test_an_output_inside_an_unfinished_run_is_refused(tmp_path):
    ibdata.generate_shards(described(), "1/2", tmp_path / "run", workers=1)
    with pytest.raises(UsageError, match="lies within the dataset"):
        ibdata.generate(described(), tmp_path / "run/data/more", workers=1)


def test_somebody_s_own_readme_in_an_unfinished_folder_stays(tmp_path):
    folder = tmp_path / "run"
    ibdata.generate_shards(described(), "1/1", folder, workers=1)
    (folder / "README.md").write_text("mine")
    for finish in (
        lambda: ibdata.finalize(folder),
        lambda: ibdata.generate(described(), folder, workers=1, resume=True),
    ):
        with pytest.raises(UsageError, match=r"README\.md: found a text that ibdata did not write; move it"):
            finish()
    assert (folder / "README.md").read_text() == "mine"
    (folder / "README.md").unlink()
    ibdata.finalize(folder)
    assert ibdata.validate(folder) == []


def test_an_edited_card_is_not_replaced_by_a_split(here):
    (here / "README.md").write_text((here / "README.md").read_text() + "Mine.\n")
    before = {name: (here / name).read_bytes() for name in names(here)}
    with pytest.raises(UsageError, match=r"README\.md: was edited, and the new splits would replace it"):
        ibdata.split(here, by="policy")
    assert {name: (here / name).read_bytes() for name in names(here)} == before


def test_a_finished_dataset_with_a_flipped_bit_is_not_taken_for_whole(here):
    path = next((here / "data").iterdir())
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(DatasetError, match="damaged or missing; run ibdata repair here"):
        ibdata.generate(described(), here, workers=1, resume=True)


def test_a_small_file_of_many_rows_is_refused_before_it_is_read(here, monkeypatch):
    path = here / json.loads((here / manifest.PATH).read_bytes())["shards"][0]["path"]
    table = pq.read_table(path).slice(0, 1)
    many = table.take(pa.array([0] * 100_000))
    pq.write_table(many, path, compression="zstd")

    def read(*_, **__):
        raise AssertionError("read")

    monkeypatch.setattr(pq.ParquetFile, "read", read)
    monkeypatch.setattr(pq.ParquetFile, "iter_batches", read)
    dataset = ibdata.open(here)
    for use in (dataset.table, lambda: list(dataset.iter_batches())):
        with pytest.raises(DatasetError, match="found 100000 rows, expected 5; see ibdata validate"):
            use()


def test_somebody_s_own_readme_in_the_place_of_the_card_is_not_overwritten(here):
    (here / "README.md").write_text("mine")
    for write in (
        lambda: ibdata.generate(described(seed=1), here, workers=1, overwrite=True),
        lambda: card(here),
    ):
        with pytest.raises(UsageError, match=r"README\.md: found a text that ibdata did not write; move it"):
            write()
    assert (here / "README.md").read_text() == "mine"


@pytest.mark.parametrize("code", [errno.EXDEV, errno.EBUSY])
def test_a_folder_that_cannot_be_moved_leaves_the_dataset_as_it_was(here, made, monkeypatch, code):
    """As one in the image of a container, or one that is a mount."""

    def refuse(*_):
        raise OSError(code, "cannot be moved")

    monkeypatch.setattr(replacement, "exchanged", refuse)
    before = {name: (here / name).read_bytes() for name in names(here)}
    for write in (
        lambda: ibdata.generate(described(seed=1), here, workers=1, overwrite=True),
        lambda: ibdata.split(here, by="policy"),
    ):
        with pytest.raises(IbdataError, match=r"here: cannot be written: (data|meta): cannot be moved"):
            write()
        assert {name: (here / name).read_bytes() for name in names(here)} == before
        assert ibdata.validate(here) == []
    assert ibdata.open(here).content_root == made[0].content_root


def half_copied(here: Path, made) -> None:
    """As between the moves of `data` and `meta`."""
    shutil.copytree(here / "data", here / ".new/data")
    staging.make(here / ".new")
    shutil.rmtree(here / "data")
    shutil.copytree(made[1].path / "data", here / "data")
    (here / "data" / manifest.FRESH).touch()


def test_a_copy_without_the_hidden_half_is_not_repaired_into_a_mixture(here, made):
    half_copied(here, made)
    shutil.rmtree(here / ".new")
    before = names(here)
    with pytest.raises(UsageError, match=r"parquet: found a file that the manifest does not list; move it"):
        ibdata.repair(here)
    assert names(here) == before


def test_a_half_whose_metadata_were_lost_is_put_back(here, made):
    half_copied(here, made)
    assert ibdata.repair(here) == []
    assert ibdata.open(here).content_root == made[0].content_root
    assert ibdata.validate(here) == []
