"""URLs: which texts are URLs, the credentials in them, and the functions and commands that refuse them."""

from __future__ import annotations

import pickle
import shutil
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest
from helpers.at_url import made
from helpers.tiny import FOUR_SHARDS
from pyarrow.fs import FileSystem

import ibdata
import ibdata.plots
from ibdata.cli import main
from ibdata.dataset.reader import Dataset
from ibdata.errors import DatasetError, IbdataError, MissingError, UsageError, hidden
from ibdata.experiment.template import write_template
from ibdata.maintenance.card import card
from ibdata.maintenance.listing import datasets_in
from ibdata.system import storage
from ibdata.system.storage import is_url


@pytest.mark.parametrize("place", ["s3://a/b", "memory://x", "file:///x", "S3://a/b", "abfs+x://y"])
def test_urls(place):
    assert is_url(place)


@pytest.mark.parametrize("place", ["s3:/a/b", "a/b", "/s3://x", "://x", "c://x", Path("s3://a"), None, ""])
def test_no_urls(place):
    assert not is_url(place)


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
    assert hidden(text) == shown


def test_a_scheme_that_nobody_knows_is_refused_in_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(MissingError, match=r"^odd:// needs the package fsspec: pip install fsspec, or"):
        ibdata.open("odd://x/y")
    with pytest.raises(UsageError, match=r"^s3://: found no name in the URL, expected"):
        ibdata.open("s3://")


@pytest.mark.parametrize(("mark", "code"), [("#", "%23"), ("?", "%3F")])
def test_a_part_of_a_url_that_would_be_passed_over_is_refused(mark, code, url):
    made(url)
    with pytest.raises(
        UsageError, match=rf"/there\{mark}x: found \{mark}, .*; expected {code} where it belongs"
    ):
        ibdata.open(f"{url}{mark}x")
    made(f"{url}{code}x")
    assert Path(f"there{mark}x/data").is_dir()


def test_the_scheme_of_a_url_may_be_in_capitals(url):
    made(url)
    assert len(ibdata.open(url.replace("file", "FILE", 1))) > 0


WITHOUT_URLS = {
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


def test_functions_that_take_no_url_say_so_and_write_nothing(url):
    made(url)
    shutil.copytree("there", "here")
    ibdata.generate(FOUR_SHARDS, "other", workers=1, seed=1)
    before = sorted(Path().rglob("*"))
    for call in WITHOUT_URLS.values():
        with pytest.raises(UsageError, match=f"^{url}.*: found a URL, expected a path on this machine$"):
            call(url)
    dataset = ibdata.open(url)
    for name in WITHOUT_URLS.keys() - {"figure", "template"}:  # whose place is a file
        with pytest.raises(UsageError, match=f"^{url}: found a URL, expected a path on this machine$"):
            WITHOUT_URLS[name](dataset)
    assert sorted(Path().rglob("*")) == before
    assert ibdata.validate(url) == []


def test_a_dataset_at_a_url_is_not_replaced(url):
    dataset = ibdata.open(made(url).place)
    with pytest.raises(UsageError, match=f"^{url}: overwrite=True is for folders"):
        ibdata.generate(FOUR_SHARDS, dataset, workers=1, seed=1, overwrite=True)


def everything_in(url):
    dataset = ibdata.open(url)
    return dataset.info, dataset.episodes, dataset.table()


@pytest.mark.parametrize(
    ("path", "changed"),
    [
        ("meta/manifest.json", b"{"),
        ("meta/dataset.json", b"{"),
        ("meta/episodes.parquet", b"x"),
        (None, b"PAR1"),
    ],
    ids=["manifest", "info", "episodes", "shard"],
)
def test_errors_name_the_file_at_the_url(url, path, changed):
    dataset = made(url)
    path = path or dataset.manifest_model.shards[0].path
    Path("there", path).write_bytes(changed)
    with pytest.raises(DatasetError, match=f"^{url}/{path}: "):
        everything_in(url)


def test_merge_names_the_urls_that_it_refuses(url):
    made(url)
    with pytest.raises(UsageError, match=f"^{url}: .* are also in {url}; make"):
        ibdata.merge([url, url], "merged")


@pytest.mark.slow
def test_a_dataset_at_a_url_is_read_in_another_process(url):
    dataset = ibdata.open(made(url).place)
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        table = pool.submit(Dataset.table, dataset).result()
    assert table.equals(dataset.table())
    assert pickle.loads(pickle.dumps(dataset)).place == url


COMMANDS = {
    "split": ("split", "here", "--by", "policy", "--materialize"),
    "export": ("export", "here", "--to", "npz", "--out"),
    "merge": ("merge", "here", "here", "--out"),
    "plot": ("plot", "here", "--out"),
    "figure": ("figure", "landscape", "--out"),
    "init": ("init",),
    "card": ("card",),
    "repair": ("repair",),
    "reproduce": ("reproduce",),
    "diff": ("diff", "here"),
    "ls": ("ls",),
}


@pytest.mark.parametrize("args", COMMANDS.values(), ids=COMMANDS)
def test_commands_that_take_no_url_say_so_and_write_nothing(args, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main([*args, "s3://user:secret@bucket/name"])
    assert ended.value.code == 2
    assert capsys.readouterr().err == "s3://…@bucket/name: found a URL, expected a path on this machine\n"
    assert list(tmp_path.iterdir()) == []
