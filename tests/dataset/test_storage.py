"""Datasets at URLs, here in pyarrow's file system of this machine; scripts/bridges has S3 and fsspec's."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment
from ibdata.dataset.storage import is_url
from ibdata.errors import MissingError, UsageError

PLAIN = {
    "name": "tiny",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "random"}],
    "episodes": 2,
    "steps": 5,
    "output": {"shard_rows": 5},
}


@pytest.fixture
def url(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return f"{tmp_path.as_uri()}/there"


def made(url, **options):
    return ibdata.generate(Experiment.model_validate(PLAIN), url, workers=1, **options)


@pytest.mark.parametrize("place", ["s3://a/b", "memory://x", "file:///x", "S3://a/b", "abfs+x://y"])
def test_urls(place):
    assert is_url(place)


@pytest.mark.parametrize("place", ["s3:/a/b", "a/b", "/s3://x", "://x", "c://x", Path("s3://a"), None, ""])
def test_no_urls(place):
    assert not is_url(place)


def test_the_same_files_are_there_as_in_a_folder(url):
    at_url, plain = made(url), made("plain")
    files = {str(p.relative_to("plain")): p.read_bytes() for p in Path("plain").rglob("*") if p.is_file()}
    assert {
        str(p.relative_to("there")): p.read_bytes() for p in Path("there").rglob("*") if p.is_file()
    } == files
    assert at_url.table().equals(plain.table())
    assert at_url.place == url
    assert at_url.path != Path("there")


@pytest.mark.slow
def test_every_reading_command_takes_a_url(url, ibdata):
    made(url)
    for command in ("info", "head", "stats", "validate"):
        done, plain = ibdata(command, url), ibdata(command, "there")
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.replace(url, "there") == plain.stdout


def test_damage_is_found_and_named(url, shard_file):
    made(url)
    shard = shard_file("there", 1)
    Path("there", shard).write_bytes(Path("there", shard).read_bytes()[:-1] + b"x")
    (problem,) = ibdata.validate(url, quick=True)
    assert (problem.path, problem.rule) == (shard, "hash")


def test_resuming_takes_what_is_there_and_another_experiment_is_refused(url):
    made(url)
    assert made(url, resume=True).content_root == made("plain").content_root
    with pytest.raises(UsageError, match=r"holds the dataset of another experiment; choose another --out$"):
        made(url, seed=5, resume=True)


def test_what_is_copied_to_read_it_goes_with_the_process(url):
    made(url)
    code = f"import ibdata; d = ibdata.open({url!r}); d.table(); print(d.path)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not Path(done.stdout.strip()).parent.exists()


def test_a_scheme_that_nobody_knows_is_refused_in_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(MissingError, match=r"^odd:// needs fsspec: pip install fsspec, or ibdata with its"):
        ibdata.open("odd://x/y")
    with pytest.raises(UsageError, match=r"^s3://: found no name in the URL, expected"):
        ibdata.open("s3://")
