"""A replacement that was interrupted: its files are compared before they replace any of the old dataset."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment
from ibdata.dataset import manifest
from ibdata.errors import DatasetError
from ibdata.generation import replacement, unsettled
from ibdata.maintenance.card import card

PLAIN = {
    "name": "tiny",
    "setpoints": 50.0,
    "policies": [{"kind": "random"}],
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


def contents(folder: Path) -> dict[Path, bytes]:
    return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def killed(*_):
    raise KeyboardInterrupt


def move(monkeypatch, here: Path, moved: list[str], exchange: bool) -> None:
    """Replace the dataset of seed 0 by that of seed 1, and be killed after moving these folders."""
    swap = replacement._swap

    def swaps(new, folder, part):
        (swap if part in moved else killed)(new, folder, part)

    with monkeypatch.context() as patched:
        patched.setattr(replacement, "_swap", swaps)
        patched.setattr(replacement, "exchanged", replacement.exchanged if exchange else lambda a, b: False)
        if moved == ["data", "meta"]:
            patched.setattr(replacement, "place_single_files", killed)
        with pytest.raises(KeyboardInterrupt):
            ibdata.generate(described(seed=1), here, workers=1, overwrite=True)


@pytest.fixture
def here(made, tmp_path, monkeypatch) -> Path:
    """A copy of the dataset of seed 0, in the current folder."""
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copytree(made[0].path, "here"))


def new_file(here: Path, name: str) -> Path:
    """A file of the replacement: a shard of the folder that is marked as new, or a single file."""
    if name != "shard":
        return here / manifest.NEW / name
    data = next(p for p in (here / ".new/data", here / "data") if (p / manifest.FRESH).is_file())
    return max(data.glob("part-00001-*"), key=lambda path: path.stat().st_size)


def is_old(here: Path, made) -> bool:
    old = contents(made[0].path)
    now = contents(here)
    return ibdata.validate(here) == [] and {path: now.get(path) for path in old} == old


@pytest.mark.parametrize(
    ("name", "moved", "exchange"),
    [
        ("shard", [], True),
        ("shard", ["data"], True),
        ("shard", ["data"], False),
        ("meta/statistics.json", [], True),
        ("meta/manifest.json", ["data"], True),
        ("README.md", [], False),
    ],
)
def test_a_damaged_replacement_is_withdrawn_and_the_old_dataset_stays(
    here, made, monkeypatch, capsys, name, moved, exchange
):
    move(monkeypatch, here, moved, exchange)
    damaged = new_file(here, name)
    damaged.write_bytes(damaged.read_bytes()[:-9])
    assert ibdata.repair(here, workers=1) == []
    assert is_old(here, made)
    assert not (here / ".new").exists()
    assert f"ibdata: {damaged}: found other content than the manifest of" in capsys.readouterr().err


def test_a_split_does_not_finish_a_damaged_replacement(here, made, monkeypatch):
    move(monkeypatch, here, [], True)
    new_file(here, "shard").write_bytes(b"x")
    ibdata.split(here, by="episode", fractions=(0.5, 0.5))
    assert ibdata.open(here).content_root == made[0].content_root
    assert ibdata.validate(here) == []


def test_nothing_is_changed_where_both_datasets_are_damaged(here, monkeypatch):
    move(monkeypatch, here, ["data"], True)
    new_file(here, "shard").write_bytes(b"x")
    (here / "meta/dataset.json").write_bytes(b"x")
    before = contents(here)
    with pytest.raises(DatasetError, match=r"part-00001-\w+\.parquet: found other content .* here/meta/info"):
        ibdata.repair(here, workers=1)
    assert contents(here) == before


def test_a_file_of_both_datasets_that_is_damaged_in_both_is_made_again(here, made, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr("ibdata.maintenance.card._report", lambda *_: None)
        patched.setattr(replacement, "_swap", killed)
        with pytest.raises(KeyboardInterrupt):
            card(here)
    (here / "meta/statistics.json").write_bytes(b"x")  # a link to the same file in .new
    assert (here / ".new/meta/statistics.json").read_bytes() == b"x"
    assert ibdata.repair(here, workers=1) == ["meta/statistics.json"]
    assert ibdata.validate(here) == []


@pytest.mark.parametrize(
    ("moved", "exchange"), [(["data"], True), (["data"], False), (["data", "meta"], True)]
)
def test_a_whole_replacement_is_finished_however_far_it_came(here, made, monkeypatch, moved, exchange):
    move(monkeypatch, here, moved, exchange)
    assert ibdata.repair(here, workers=1) == []
    assert ibdata.open(here).content_root == made[1].content_root
    assert ibdata.validate(here) == []


def test_old_data_that_were_moved_in_two_steps_are_put_back_where_the_new_metadata_are_lost(
    here, made, monkeypatch
):
    move(monkeypatch, here, ["data"], False)
    shutil.rmtree(here / ".new/meta")
    assert ibdata.repair(here, workers=1) == []
    assert is_old(here, made)


def test_a_replacement_that_nothing_interrupts_reads_no_shard_again(here, made, monkeypatch):
    monkeypatch.setattr(unsettled, "file_sha256", killed)
    ibdata.generate(described(seed=1), here, workers=1, overwrite=True)
    assert ibdata.open(here).content_root == made[1].content_root
