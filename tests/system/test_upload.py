"""Writing a dataset to a URL: made on this machine, then uploaded whole, the manifest last."""

from __future__ import annotations

import itertools
import signal
from pathlib import Path

import pytest
from helpers.at_url import made
from helpers.folders import contents
from helpers.tiny import FOUR_SHARDS as TINY

import ibdata
from ibdata.dataset import manifest
from ibdata.errors import IbdataError, Interrupted, UsageError
from ibdata.generation import upload
from ibdata.system.storage import Remote

FILES = 11  # of the dataset
PUT = Remote.put


@pytest.fixture(autouse=True)
def cache(url, tmp_path, monkeypatch):
    """The folder of this machine in which datasets wait for their upload."""
    folder = tmp_path / "cache"
    monkeypatch.setattr(upload, "places", lambda url, e: (folder / str(e.seed) / "dataset", Remote(url)))
    return folder


def interrupted(monkeypatch, url, puts, torn=False):
    """An upload that ends after so many files, perhaps with a part of the next one."""
    calls = iter(range(puts))

    def failing(self, source, path):
        if next(calls, None) is None:
            if torn:
                Path("piece").write_bytes(source.read_bytes()[:-7])
                PUT(self, Path("piece"), path)
                Path("piece").unlink()
            raise OSError("connection lost")
        PUT(self, source, path)

    with monkeypatch.context() as broken:
        broken.setattr(Remote, "put", failing)
        with pytest.raises(IbdataError, match=r"there: cannot be written: connection lost; --resume tries"):
            made(url)


def test_the_same_files_are_there_as_in_a_folder(url, tiny, cache, files):
    """A dataset at a URL has the files of one in a folder, and nothing stays on this machine."""
    dataset = made(url)
    assert files("there") == files(tiny[0].path)
    assert len(files("there")) == FILES
    assert dataset.table().equals(tiny[0].table())
    assert (dataset.place, dataset.content_root) == (url, tiny[0].content_root)
    assert not contents(cache)


def test_the_manifest_is_uploaded_last(url, monkeypatch):
    """Until all other files are there, nobody takes the place for a dataset."""
    paths = []

    def noting(self, source, path):
        paths.append(path)
        PUT(self, source, path)

    monkeypatch.setattr(Remote, "put", noting)
    made(url)
    assert (len(paths), paths[-1]) == (FILES, manifest.PATH)


@pytest.mark.parametrize(("puts", "torn"), list(itertools.product((0, 1, 7, FILES - 1), (False, True))))
def test_a_broken_upload_is_repeated(url, tiny, monkeypatch, files, puts, torn, capsys):
    """An upload that failed is refused without --resume, and repeated in full with it."""
    interrupted(monkeypatch, url, puts, torn)
    before = contents("there")
    if before:
        with pytest.raises(IbdataError):
            made(url)
        assert contents("there") == before
    monkeypatch.setattr("ibdata.generation.workers.make_shard", None)  # no shard is made again
    made(url, resume=True)
    assert files("there") == files(tiny[0].path)
    assert ibdata.validate(url) == []
    assert capsys.readouterr().err == ""


def test_another_experiment_is_refused(url, monkeypatch):
    """Neither a dataset nor an upload that failed is replaced by another experiment."""
    interrupted(monkeypatch, url, 4)
    for _ in range(2):
        before = contents("there")
        for options in ({}, {"resume": True}):
            with pytest.raises(UsageError, match=r"holds (files, but no|the dataset of another)"):
                made(url, seed=1, **options)
        assert contents("there") == before
        made(url, resume=True)


@pytest.mark.parametrize("path", ["notes.txt", "meta/own.json", "data/own.parquet"])
@pytest.mark.parametrize("begun", [False, True])
def test_other_files_are_named_and_left_alone(url, tiny, monkeypatch, files, path, begun):
    """Files that no upload of this machine has put are refused, also with --resume."""
    if begun:
        interrupted(monkeypatch, url, 4)
    Path("there", path).parent.mkdir(parents=True, exist_ok=True)
    Path("there", path).write_text("mine")
    before = contents("there")
    for options in ({}, {"resume": True}):
        with pytest.raises(UsageError, match=r"there: holds files, but no finished dataset, such as "):
            made(url, **options)
    assert contents("there") == before
    Path("there", path).unlink()
    made(url, resume=True)
    assert files("there") == files(tiny[0].path)


@pytest.mark.parametrize("options", [{}, {"resume": True}])
def test_a_dataset_that_is_there_is_opened(url, monkeypatch, options):
    """A finished dataset of the same experiment is opened, and nothing is put."""
    first = made(url).manifest
    monkeypatch.setattr(Remote, "put", None)
    assert made(url, **options).manifest == first


def test_a_dataset_at_a_url_is_not_replaced(url):
    """--overwrite is for folders: an object store cannot exchange two of them."""
    dataset = made(url)
    with pytest.raises(UsageError, match=f"^{url}: --overwrite is for folders"):
        ibdata.generate(TINY, dataset.place, workers=1, seed=1, overwrite=True)


def test_a_signal_stops_an_upload(url, tiny, monkeypatch, files):
    """A signal ends an upload between two files, and --resume repeats it."""

    def stopping(self, source, path):
        PUT(self, source, path)
        signal.raise_signal(signal.SIGTERM)

    with monkeypatch.context() as patched:
        patched.setattr(Remote, "put", stopping)
        with pytest.raises(Interrupted, match=r"; the dataset is not uploaded; --resume uploads it$"):
            made(url)
    assert len(files("there")) == 1
    made(url, resume=True)
    assert files("there") == files(tiny[0].path)


def test_a_url_inside_a_dataset_is_refused(url, tmp_path):
    """A URL that names a folder of this machine is refused like that folder."""
    made(url)
    with pytest.raises(UsageError, match="lies within the dataset"):
        made(f"file://{tmp_path}/there/data/in")
    assert not Path("there/data/in").exists()
