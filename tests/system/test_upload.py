"""An upload that was interrupted goes on, or is refused where it is not the same."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from helpers.at_url import made
from helpers.tiny import FOUR_SHARDS
from ibdata.system.object_store import Remote

import ibdata
from ibdata import Experiment
from ibdata.dataset import manifest
from ibdata.errors import BusyError, IbdataError, UsageError
from ibdata.generation import upload


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Go to a machine: its folder of unfinished uploads is another."""

    def go(name):
        monkeypatch.setattr(upload, "cache_base", lambda: str(tmp_path / name))

    go("first")
    return go


def interrupted(monkeypatch, url, puts, torn=False, **options):
    """An upload that ends after so many files, or in the next one."""
    calls, put = iter(range(puts)), Remote.put

    def failing(self, source, path):
        if next(calls, None) is None:
            if torn:
                Path("part").write_bytes(source.read_bytes()[:-7])
                put(self, Path("part"), path)
            raise OSError("connection lost")
        put(self, source, path)

    with monkeypatch.context() as broken:
        broken.setattr(Remote, "put", failing)
        with pytest.raises(IbdataError, match=r"connection lost; resume=True uploads what is missing$"):
            made(url, **options)


def names(folder="there"):
    """The names of the files below a folder."""
    return sorted(str(path.relative_to(folder)) for path in Path(folder).rglob("*") if path.is_file())


def is_one_dataset(url):
    """Whether a URL holds the files of its dataset, and no others."""
    dataset = ibdata.open(url)
    listed = [file["path"] for file in dataset.manifest["files"]]
    rows = sum(pq.read_metadata(path).num_rows for path in Path("there/data").iterdir())
    return (
        names() == sorted([*listed, manifest.SPLITS, manifest.PATH])
        and rows == len(dataset)
        and ibdata.validate(url) == []
    )


@pytest.mark.slow
@pytest.mark.parametrize(("puts", "torn"), [(0, True), *itertools.product((1, 5, 9), (False, True))])
def test_an_upload_is_resumed_here_and_begun_again_on_another_machine(url, machine, monkeypatch, puts, torn):
    root = made("plain").content_root
    for name in ("first", "second"):
        shutil.rmtree("there", ignore_errors=True)
        machine("first")
        interrupted(monkeypatch, url, puts, torn)
        before = names()
        with pytest.raises(UsageError, match="holds an upload that was interrupted; resume=True"):
            made(url)
        assert names() == before
        machine(name)
        if puts == 0 and name == "second":
            with pytest.raises(UsageError, match=r"there/meta/pending\.json: found no valid JSON"):
                made(url, resume=True)
            assert names() == before
            continue
        assert made(url, resume=True).content_root == root
        assert is_one_dataset(url)


@pytest.mark.parametrize("name", ["first", "second"])
@pytest.mark.parametrize("puts", [1, 4, 9])
def test_an_upload_of_another_experiment_is_left_alone(url, machine, monkeypatch, puts, name):
    interrupted(monkeypatch, url, puts)
    before = names()
    machine(name)
    for options in ({}, {"resume": True}):
        with pytest.raises(UsageError, match=r"upload (that was interrupted|of another experiment);"):
            made(url, seed=1, **options)
    assert names() == before
    assert made(url, resume=True).manifest["experiments"][0]["seed"] == 0


@pytest.mark.parametrize("name", ["first", "second"])
def test_an_upload_that_lacks_its_last_step_only_is_finished(url, machine, monkeypatch, name):
    with monkeypatch.context() as broken:
        broken.setattr(Remote, "remove", lambda self, path: next(iter(())))
        with pytest.raises(StopIteration):
            made(url)
    assert "meta/pending.json" in names()
    before = names()
    machine(name)
    for options, line in (({}, "exists already"), ({"seed": 1, "resume": True}, "of another experiment")):
        with pytest.raises(UsageError, match=line):
            made(url, **options)
    assert names() == before
    made(url, resume=True)
    assert names() == [path for path in before if path != "meta/pending.json"]
    assert is_one_dataset(url)


@pytest.mark.parametrize("puts", [2, 5])
def test_an_upload_stops_where_another_machine_has_begun_its_own(url, monkeypatch, puts):
    put, count = Remote.put, 0

    def counted(self, source, path):
        nonlocal count
        count += 1
        put(self, source, path)
        if count == puts:
            with self._files.open_output_stream(f"{self._base}/meta/pending.json") as stream:
                stream.write(b"another upload")

    monkeypatch.setattr(Remote, "put", counted)
    with pytest.raises(BusyError, match="another machine is uploading there; this upload has stopped"):
        made(url)
    assert count == puts
    assert manifest.PATH not in names()


@pytest.mark.parametrize("path", ["README.md", "meta/statistics.json", "data/own.parquet", manifest.PATH])
@pytest.mark.parametrize("begun", [False, True])
def test_files_that_no_upload_has_put_are_refused_by_name_and_left_alone(
    url, machine, monkeypatch, path, begun
):
    path = f"own-{path}" if begun and path == "README.md" else path
    path = path.replace("statistics", "own") if begun else path
    if begun:
        interrupted(monkeypatch, url, 4)
    Path("there", path).parent.mkdir(parents=True, exist_ok=True)
    Path("there", path).write_text("mine")
    before = names()
    for options in ({}, {"resume": True}):
        with pytest.raises(UsageError, match=rf"there.*{path}") as error:
            made(url, **options)
        assert "resume" not in str(error.value)
    assert names() == before
    assert Path("there", path).read_text() == "mine"
    Path("there", path).unlink()
    made(url, resume=True)
    assert is_one_dataset(url)


def test_other_code_than_an_upload_began_with_is_not_to_be_overwritten(url, monkeypatch):
    experiment = {**FOUR_SHARDS.model_dump(), "policies": [{"kind": "custom", "target": "own_code:P"}]}
    text = "class P:\n    def predict(self, o):\n        return [[{}] * 3] * len(o)\n"

    def make(size, **options):
        Path("own_code.py").write_text(text.format(size))
        policy = Experiment.model_validate(experiment)
        return ibdata.generate(policy, url, workers=1, allow_code=True, **options)

    def cut(*_):
        raise OSError("cut")

    with monkeypatch.context() as patched:
        patched.setattr(upload, "_put_all", cut)
        with pytest.raises(IbdataError, match="cut"):
            make(0.25)
    for _ in range(2):
        said = r"restore it and resume=True, or choose another out=…$"
        with pytest.raises(UsageError, match=said) as refused:
            make(0.5, resume=True)
        assert str(refused.value).startswith(f"{url}: found other code")
        make(0.25, resume=True)
