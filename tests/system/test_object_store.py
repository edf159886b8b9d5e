"""Datasets at URLs in pyarrow's local file system; scripts/bridges tests S3 and fsspec's file systems."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from pyarrow.fs import FileSystem

import ibdata
from ibdata import Experiment
from ibdata.cli import main
from ibdata.dataset import manifest
from ibdata.errors import DatasetError, IbdataError, MissingError, UsageError, hidden
from ibdata.system import object_store
from ibdata.system.object_store import is_url

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
    files, others = (
        {str(p.relative_to(folder)): p.read_bytes() for p in Path(folder).rglob("*") if p.is_file()}
        for folder in ("there", "plain")
    )
    assert set(files) == {file["path"] for file in at_url.manifest["files"]} | {manifest.PATH}
    shards = [sorted(data for path, data in found.items() if "data/" in path) for found in (files, others)]
    assert shards[0] == shards[1]
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


SECRETS = ("KEY", "SECRET", "TOKEN")
URLS = {  # and how errors begin that name them
    "s3://KEY:SECRET@/": "s3://…@/: found no name",
    "s3://KEY:SECRET@bucket/a/b?secret_key=TOKEN": "s3://…@bucket/a/b?secret_key=…: Unexpected",
    "s3://KEY:SEC/RET@bucket/a": "s3://…@bucket/a: Cannot parse URI: 's3://…@bucket/a'",
    "odd://KEY:SECRET@host/a?sig=TOKEN&region=eu": "odd:// needs the package fsspec",
    "hf://KEY:SECRET@host/a": "hf:// needs ",
    "hdfs://KEY:SECRET@host/a": "hdfs://…@host/a: ",
}


@pytest.mark.parametrize("url", URLS)
def test_credentials_in_urls_are_in_no_error(url, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    if url.startswith("odd"):
        monkeypatch.setitem(sys.modules, "fsspec", None)
    calls = [ibdata.open, ibdata.validate, made, lambda url: ibdata.generate_shards("random", "1/1", url)]
    calls += [ibdata.repair, ibdata.split, lambda url: ibdata.merge([url, url], out="x")]
    calls += [lambda url: ibdata.generate_all("siemens-offline", out=url)]
    for i, call in enumerate(calls):
        with pytest.raises(IbdataError) as error:
            call(url)
        assert not any(secret in str(error.value) for secret in (*SECRETS, "RET", "SEC"))
        assert str(error.value).startswith(URLS[url]) or i > 2
    assert not Path("x").exists()


def test_credentials_in_urls_are_in_no_result(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    made("there")
    files = FileSystem.from_uri(tmp_path.as_uri())[0]
    monkeypatch.setattr(object_store, "_file_system", lambda url: (files, str(tmp_path / "there")))
    url = "s3://KEY:SECRET@bucket/there?secret_key=TOKEN"
    dataset = ibdata.open(url)
    assert dataset.place == "s3://…@bucket/there?secret_key=…"
    assert repr(dataset).startswith("<ibdata.Dataset s3://…@bucket/there?secret_key=…: 20 rows")
    assert len(dataset.table()) == 20
    for command in ("info", "head", "stats", "validate"):
        for more in ([], ["--json"]):
            with pytest.raises(SystemExit) as end:
                main([command, url, *more])
            assert not end.value.code
            assert not any(secret in "".join(capsys.readouterr()) for secret in SECRETS)
    Path("there/meta/info.json").write_text("{}", encoding="utf-8")
    with pytest.raises(DatasetError) as error:
        _ = ibdata.open(url).info
    assert not any(secret in str(error.value) for secret in SECRETS)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("s3://bucket/a@b: x", "s3://bucket/a@b: x"),
        ("s3://KEY@bucket/a@b", "s3://…@bucket/a@b"),
        ("http://host:80/a@b", "http://host:80/a@b"),
        ("s3:/KEY:SECRET@bucket/a", "s3:/…@bucket/a"),
        ("https://x/?sig=KEY&region=eu, http://u:KEY@y", "https://x/?sig=…&region=eu, http://…@y"),
        ("a/b: c@d:e", "a/b: c@d:e"),
    ],
)
def test_what_is_hidden(text, shown):
    assert hidden(text) == shown


def test_a_scheme_that_nobody_knows_is_refused_in_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(MissingError, match=r"^odd:// needs the package fsspec: pip install fsspec, or"):
        ibdata.open("odd://x/y")
    with pytest.raises(UsageError, match=r"^s3://: found no name in the URL, expected"):
        ibdata.open("s3://")
