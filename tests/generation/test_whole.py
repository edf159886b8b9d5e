"""All shards or an error: what is not whole is never published, and nothing of it is deleted."""

import os
from pathlib import Path
from unittest.mock import Mock

import pytest
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.datasets import four_shards_at
from helpers.folders import is_right, part_of

import ibdata
from ibdata import IbdataError
from ibdata.errors import DatasetError
from ibdata.generation import upload, workers
from ibdata.system.storage import Remote
from ibdata.writing import shard as shard_writing


def unreadable(monkeypatch):
    """The receipt of shard 2 after its file was made, as a client of a network file system sees it."""
    real = shard_writing.read_receipt
    found = lambda root, shard: None if shard.number == 2 else real(root, shard)  # noqa: E731
    monkeypatch.setattr(shard_writing, "read_receipt", found)


def cut(monkeypatch):
    """The file of shard 2, of which a part is on the disk."""
    real = workers.write_receipt

    def putting(root, written):
        real(root, written)
        if written.shard.number == 2:
            path = root / shard_writing.DATASET / written.entry.path
            path.write_bytes(path.read_bytes()[:-7])

    monkeypatch.setattr(workers, "write_receipt", putting)


WAYS = {
    "run": lambda: ibdata.generate(TINY, "out", workers=1),
    "overwrite": lambda: ibdata.generate(TINY, "out", workers=1, overwrite=True),
    "finalize": lambda: (ibdata.generate(TINY, "out", workers=1, shards="1/1"), ibdata.finalize("out")),
}


@pytest.mark.parametrize("lose", [unreadable, cut])
@pytest.mark.parametrize("write", WAYS.values(), ids=WAYS)
def test_a_lost_shard_is_an_error_and_the_run_goes_on(tiny, files, monkeypatch, lose, write):
    with monkeypatch.context() as broken:
        lose(broken)
        with pytest.raises(
            IbdataError, match=r"^out: 1 of 4 shards are missing or damaged: 2; .*--resume"
        ) as e:
            write()
    assert (e.value.exit_code, Path("out").exists()) == (1, False)
    assert len(list((part_of("out") / "dataset/data").iterdir())) == 4
    ibdata.generate(TINY, "out", workers=1, resume=True)
    assert is_right("out", tiny[0].path, files)
    assert ibdata.validate("out") == []


def test_receipts_that_cannot_be_listed_are_not_none(monkeypatch):
    ibdata.generate(TINY, "out", workers=1, shards="1/2")
    listed = os.listdir

    def failing(folder="."):
        if Path(folder).name == "receipts":
            raise OSError(116, "Stale file handle")
        return listed(folder)

    with monkeypatch.context() as broken:
        broken.setattr("ibdata.system.part.os.listdir", failing)
        with pytest.raises(IbdataError, match=r"^out: cannot be written: Stale file handle"):
            ibdata.generate(TINY, "out", workers=1, resume=True)
    assert len(list((part_of("out") / "receipts").iterdir())) == 2


def test_what_was_lost_before_its_upload_is_made_again(tmp_path, monkeypatch, tiny, files):
    monkeypatch.chdir(tmp_path)
    url = f"{tmp_path.as_uri()}/there"
    monkeypatch.setattr(upload, "places", lambda url, e: (tmp_path / "cache/dataset", Remote(url)))
    with monkeypatch.context() as broken:
        broken.setattr(Remote, "put", Mock(side_effect=OSError(5, "lost")))
        with pytest.raises(IbdataError, match="--resume tries again"):
            four_shards_at(url)
    next(Path("cache/dataset/data").iterdir()).unlink()
    four_shards_at(url, resume=True)
    assert files("there") == files(tiny[0].path)


def test_a_dataset_that_is_not_whole_is_not_already_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    url = f"{tmp_path.as_uri()}/there"
    four_shards_at(url)
    next(Path("there/data").glob("part-00002-*")).unlink()
    for call in (
        lambda: four_shards_at(url),
        lambda: four_shards_at("there"),
        lambda: four_shards_at("there", shards="1/2"),
        lambda: ibdata.finalize("there"),
    ):
        with pytest.raises(DatasetError, match=r"there/data/part-00002-.*: missing or not whole, but"):
            call()
    assert ibdata.repair("there") != []
    assert four_shards_at(url).content_root == four_shards_at("there").content_root
