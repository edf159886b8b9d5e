"""Datasets at URLs, in pyarrow's local file system: what reads them, what refuses them, and no credentials.

scripts/bridges tests S3 and the file systems of fsspec.
"""

from __future__ import annotations

import pickle
import shutil
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest
from helpers.at_url import made
from helpers.folders import contents
from helpers.tiny import FOUR_SHARDS as TINY
from pyarrow.fs import FileSystem

import ibdata
import ibdata.plots
from ibdata.cli import main
from ibdata.dataset.reader import Dataset
from ibdata.errors import DatasetError, IbdataError, UsageError, hidden
from ibdata.experiment.template import write_template
from ibdata.maintenance.card import card
from ibdata.maintenance.listing import datasets_in
from ibdata.system import storage
from ibdata.system.storage import is_url


@pytest.mark.parametrize("place", ["s3://a/b", "memory://x", "file:///x", "S3://a/b", "abfs+x://y"])
def test_urls(place):
    """A text with a scheme of at least two letters and two slashes is a URL."""
    assert is_url(place)


@pytest.mark.parametrize("place", ["s3:/a/b", "a/b", "/s3://x", "://x", "c://x", Path("s3://a"), None, ""])
def test_no_urls(place):
    """All else is a path."""
    assert not is_url(place)


# --- reading


@pytest.mark.slow
def test_every_reading_command_takes_a_url(url, ibdata):
    """Commands that read a dataset say the same of it at a URL and in a folder."""
    made(url)
    for command in ("info", "head", "stats", "validate"):
        done, plain = ibdata(command, url), ibdata(command, "there")
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.replace(url, "there") == plain.stdout


def test_damage_is_found_and_named(url, shard_file):
    """`validate` finds changed, strange and missing files at a URL, and `open` names the last."""
    made(url)
    shard = shard_file("there", 1)
    Path("there", shard).write_bytes(Path("there", shard).read_bytes()[:-1] + b"x")
    shutil.copy(Path("there", shard), "there/data/part-00009-00000000.parquet")
    Path("there/meta/statistics.json").unlink()
    found = {(problem.path, problem.rule) for problem in ibdata.validate(url, quick=True)}
    lost, strange = "meta/statistics.json", "data/part-00009-00000000.parquet"
    assert found == {(shard, "hash"), (strange, "file"), (lost, "file")}
    with pytest.raises(DatasetError, match=f"^{url}/{lost}: missing$"):  # `repair` takes no URL
        ibdata.open(url).statistics()


@pytest.mark.parametrize(
    "path", ["meta/manifest.json", "meta/dataset.json", "meta/episodes.parquet", "data/*.parquet"]
)
def test_errors_name_the_file_at_the_url(url, path):
    """Whatever file is damaged, the error begins with its place at the URL."""
    made(url)
    file = next(Path("there").glob(path))
    file.write_bytes(b"{")
    with pytest.raises(DatasetError, match=f"^{url}/{file.relative_to('there')}: "):
        everything_in(ibdata.open(url))


def everything_in(dataset):
    return dataset.info, dataset.episodes, dataset.table()


@pytest.mark.slow
def test_another_process_may_read_a_dataset(url):
    """A dataset at a URL can be pickled, as for the workers of a data loader."""
    dataset = made(url)
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        table = pool.submit(Dataset.table, dataset).result()
    assert table.equals(dataset.table())
    assert pickle.loads(pickle.dumps(dataset)).place == url


# --- credentials

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
    """No error of a function that gets a URL with credentials holds them."""
    monkeypatch.chdir(tmp_path)
    if url.startswith("odd"):
        monkeypatch.setitem(sys.modules, "fsspec", None)
    calls = [ibdata.open, ibdata.validate, made, lambda url: ibdata.generate("random", url, shards="1/1")]
    calls += [ibdata.repair, ibdata.split, lambda url: ibdata.merge([url, url], out="x")]
    calls += [lambda url: ibdata.generate("siemens-offline", out=url)]
    for i, call in enumerate(calls):
        with pytest.raises(IbdataError) as error:
            call(url)
        assert not any(secret in str(error.value) for secret in (*SECRETS, "RET", "SEC"))
        assert str(error.value).startswith(URLS[url]) or i > 2
    assert not Path("x").exists()


def test_credentials_in_urls_are_in_no_result(tmp_path, monkeypatch, capsys):
    """Neither a dataset's representation nor what commands print of it holds credentials."""
    monkeypatch.chdir(tmp_path)
    made("there")
    files = FileSystem.from_uri(tmp_path.as_uri())[0]
    monkeypatch.setattr(storage, "_file_system", lambda url: (files, str(tmp_path / "there")))
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
    Path("there/meta/dataset.json").write_text("{}", encoding="utf-8")
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
    """Credentials and the values of unknown parameters are hidden, and nothing else."""
    assert hidden(text) == shown


def test_a_scheme_that_nobody_knows_is_refused(monkeypatch):
    """A URL without a file system or without a name is an error of one line."""
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(ImportError, match=r"^odd:// needs the package fsspec: pip install fsspec, or"):
        ibdata.open("odd://x/y")
    with pytest.raises(UsageError, match=r"^s3://: found no name in the URL, expected"):
        ibdata.open("s3://")


# --- what takes no URL

WITHOUT_URLS = {
    "path": lambda url: ibdata.open(url).path,
    "fspath": lambda url: Path(ibdata.open(url)),
    "materialize": lambda url: ibdata.split("here", "episode", fractions=(0.5, 0.5), materialize=url),
    "label": lambda url: ibdata.split(url, "episode", fractions=(0.5, 0.5)),
    "merge": lambda url: ibdata.merge(["here", "other"], url),
    "export": lambda url: ibdata.export("here", to="npz", out=url),
    "plot": lambda url: ibdata.plots.plot("here", out=url),
    "figure": lambda url: ibdata.plots.figure("landscape", out=f"{url}.png"),
    "card": lambda url: card(url),
    "repair": lambda url: ibdata.repair(url),
    "reproduce": lambda url: ibdata.reproduce(url),
    "finalize": lambda url: ibdata.finalize(url),
    "template": lambda url: write_template(f"{url}.yaml"),
    "datasets": lambda url: datasets_in(url),
}


def test_functions_that_take_no_url_say_so(url):
    """Functions that need a folder refuse a URL, and a dataset at one, in one line and write nothing."""
    dataset = made(url)
    shutil.copytree("there", "here")
    ibdata.generate(TINY, "other", workers=1, seed=1)
    before = contents()
    for name, call in WITHOUT_URLS.items():
        as_dataset = name not in ("figure", "template", "path", "fspath")  # whose place is no dataset
        for place in (url, dataset) if as_dataset else (url,):
            with pytest.raises(UsageError, match=f"^{url}.*: found a URL, expected a path on this machine$"):
                call(place)
    with pytest.raises(UsageError, match=f"^{url}: .* are also in {url}; make"):
        ibdata.merge([url, url], "merged")
    assert contents() == before
