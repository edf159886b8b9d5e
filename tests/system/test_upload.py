"""Writing a dataset to a URL: made on this machine, then uploaded whole, the manifest last."""

import signal
from pathlib import Path

import pytest
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.datasets import four_shards_at
from helpers.folders import contents

import ibdata
from ibdata._system.part import locked_part
from ibdata._system.storage import Remote
from ibdata.dataset import manifest
from ibdata.errors import BusyError, IbdataError, Interrupted, UsageError
from ibdata.generation import upload
from ibdata.generation.shard import write_receipt

FILES = 12  # of the dataset
PUT = Remote.put


@pytest.fixture(autouse=True)
def cache(url, tmp_path, monkeypatch):
    """The folder of this machine in which datasets wait for their upload."""
    folder = tmp_path / "cache"
    monkeypatch.setattr(upload, "work_folder", lambda url: folder / "0" / "dataset")
    return folder


@pytest.fixture
def is_whole(tiny, files):
    """Whether the dataset at the URL has the files of one in a folder."""
    return lambda: files("there") == files(tiny[0].path)


def interrupted(monkeypatch, url, puts):
    """An upload that ends after so many files and a part of the next one."""
    calls = iter(range(puts))

    def failing(self, source, path):
        if next(calls, None) is None:
            Path("piece").write_bytes(source.read_bytes()[:-7])
            PUT(self, Path("piece"), path)
            Path("piece").unlink()
            raise OSError("connection lost")
        PUT(self, source, path)

    with monkeypatch.context() as broken:
        broken.setattr(Remote, "put", failing)
        with pytest.raises(
            IbdataError, match=r"there: cannot be written: connection lost; the same command tries"
        ):
            four_shards_at(url)


def test_the_files_of_a_folder_are_there_the_manifest_last(url, tiny, cache, is_whole, monkeypatch):
    """Until all other files are there, nobody takes the place for a dataset; nothing stays here."""
    paths = []

    def noting(self, source, path):
        paths.append(path)
        PUT(self, source, path)

    monkeypatch.setattr(Remote, "put", noting)
    dataset = four_shards_at(url)
    assert is_whole()
    assert (len(paths), paths[-1]) == (FILES, manifest.PATH)
    assert dataset.table().equals(tiny[0].table())
    assert (dataset.place, dataset.content_root) == (url, tiny[0].content_root)
    assert not contents(cache)
    paths.clear()
    assert four_shards_at(url).manifest == dataset.manifest
    assert paths == []


def test_another_experiment_waits_for_the_one_that_is_not_uploaded(url, monkeypatch, cache, is_whole):
    """Finished, or begun; what has been uploaded is in nobody's way."""
    interrupted(monkeypatch, url, 4)
    with pytest.raises(
        UsageError, match=r"there: holds the dataset of another .*; remove cache/0/\S* to drop it, or"
    ):
        four_shards_at(url, seed=1)
    four_shards_at(url)
    assert is_whole()
    with monkeypatch.context() as broken:
        broken.setattr("ibdata.generation.workers.write_receipt", stop_after(2))
        with pytest.raises(Interrupted):
            four_shards_at(url + "-too")
    with pytest.raises(
        UsageError, match=r"too: holds an unfinished run of another .*; remove cache/0/\S* to drop it, or"
    ):
        four_shards_at(url + "-too", seed=1)


def test_files_of_an_upload_whose_dataset_was_damaged_are_not_mixed_with_others(url, monkeypatch, cache):
    """They have other names, and a glob would read both."""
    interrupted(monkeypatch, url, 3)
    next(path for path in sorted((cache / "0/dataset/data").iterdir())[-1:]).write_bytes(b"")
    with pytest.raises(UsageError, match=r"there: holds other files, such as data/part-.*; remove them$"):
        four_shards_at(url)


def stop_after(shards):
    calls = iter(range(shards))

    def stopping(*args):
        if next(calls, None) is None:
            raise Interrupted(15)
        write_receipt(*args)

    return stopping


@pytest.mark.parametrize("puts", [0, FILES - 1])
def test_a_broken_upload_is_repeated(url, monkeypatch, is_whole, puts, capsys):
    interrupted(monkeypatch, url, puts)
    monkeypatch.setattr("ibdata.generation.workers.make_shard", None)  # no shard is made again
    four_shards_at(url)
    assert is_whole()
    assert capsys.readouterr().err == ""


def test_what_was_lost_before_its_upload_is_made_again(url, cache, monkeypatch, is_whole):
    interrupted(monkeypatch, url, 0)
    next(cache.glob("*/dataset/data/*")).unlink()
    four_shards_at(url)
    assert is_whole()


def test_other_files_are_named_and_left_alone(url, monkeypatch):
    interrupted(monkeypatch, url, 4)
    Path("there/data/own.parquet").write_text("mine")
    before = contents("there")
    with pytest.raises(UsageError, match=r"there: holds files, but no finished dataset, such as "):
        four_shards_at(url)
    assert contents("there") == before


def test_a_signal_stops_an_upload(url, monkeypatch, is_whole):
    """Between two files."""

    def stopping(self, source, path):
        PUT(self, source, path)
        signal.raise_signal(signal.SIGTERM)

    with monkeypatch.context() as patched:
        patched.setattr(Remote, "put", stopping)
        with pytest.raises(Interrupted, match=r"; the dataset is not uploaded; the same command uploads it$"):
            four_shards_at(url)
    assert len([path for path in Path("there").rglob("*") if path.is_file()]) == 1
    four_shards_at(url)
    assert is_whole()


def test_what_a_url_cannot_do_is_refused(url, tmp_path):
    """An object store cannot exchange two folders; and a URL may name a folder of this machine."""
    four_shards_at(url)
    with pytest.raises(UsageError, match=f"^{url}: overwrite=True is for folders"):
        ibdata.generate(TINY, url, workers=1, seed=1, overwrite=True)
    with pytest.raises(UsageError, match="lies within the dataset"):
        four_shards_at(f"file://{tmp_path}/there/data/in")
    assert not Path("there/data/in").exists()


def test_of_two_uploads_at_once_one_waits(url, cache, is_whole):
    """Neither removes what the other one uploads."""
    target = cache / "0" / "dataset"
    with locked_part(target), pytest.raises(BusyError, match=r"there: another process is writing here; wait"):
        four_shards_at(url)
    assert not Path("there").exists()
    four_shards_at(url)
    assert is_whole()
