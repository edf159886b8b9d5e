"""Datasets at URLs in pyarrow's local file system; scripts/bridges tests S3 and fsspec's file systems."""

from __future__ import annotations

import itertools
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from helpers.tiny import FOUR_SHARDS
from pyarrow.fs import FileSystem

import ibdata
import ibdata.plots
from ibdata import Experiment
from ibdata.cli import main
from ibdata.dataset import manifest
from ibdata.errors import BusyError, DatasetError, IbdataError, MissingError, UsageError, hidden
from ibdata.experiment.template import write_template
from ibdata.generation import upload
from ibdata.maintenance.card import card
from ibdata.maintenance.listing import datasets_in
from ibdata.system import object_store
from ibdata.system.object_store import Remote, is_url


@pytest.fixture
def url(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return f"{tmp_path.as_uri()}/there"


def made(url, **options):
    return ibdata.generate(FOUR_SHARDS, url, workers=1, **options)


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
    with pytest.raises(UsageError, match=r"holds the dataset of another experiment; choose another out=…$"):
        made(url, seed=5, resume=True)


@pytest.mark.parametrize("cut", [False, True])
def test_resuming_names_a_file_of_the_finished_dataset_that_is_missing(url, cut):
    made(url)
    path = sorted(Path("there/data").iterdir())[1]
    path.write_bytes(path.read_bytes()[:-1]) if cut else path.unlink()
    with pytest.raises(DatasetError, match=rf"data/{path.name} (is missing|has \d+ bytes, expected \d+);"):
        made(url, resume=True)


# --- an upload that was interrupted


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
    return names() == sorted([*listed, manifest.PATH]) and rows == len(dataset) and ibdata.validate(url) == []


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


@pytest.mark.parametrize("path", ["README.md", "meta/stats.json", "data/own.parquet", manifest.PATH])
@pytest.mark.parametrize("begun", [False, True])
def test_files_that_no_upload_has_put_are_refused_by_name_and_left_alone(
    url, machine, monkeypatch, path, begun
):
    path = f"own-{path}" if begun and path == "README.md" else path
    path = path.replace("stats", "own") if begun else path
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


def test_a_file_that_the_manifest_does_not_list_is_found(url):
    made(url)
    shutil.copy(next(Path("there/data").iterdir()), "there/data/part-00009-00000000.parquet")
    (problem,) = ibdata.validate(url)
    assert (problem.path, problem.rule) == ("data/part-00009-00000000.parquet", "file")


def test_threads_may_read_one_dataset(url):
    made(url)
    for _ in range(5):
        dataset = ibdata.open(url)
        with ThreadPoolExecutor(8) as threads:
            tables = [threads.submit(dataset.table) for _ in range(8)]
        assert {len(table.result()) for table in tables} == {20}


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
    assert sorted(Path().rglob("*")) == before
    assert ibdata.validate(url) == []


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


def test_a_missing_file_at_a_url_is_not_said_to_be_made_by_repair(url):
    made(url)
    Path("there/meta/stats.json").unlink()
    (problem,) = ibdata.validate(url, quick=True)
    assert problem.message == "found no file that can be read"
    with pytest.raises(DatasetError, match=f"^{url}/meta/stats.json: missing$"):
        ibdata.open(url).statistics()


def test_a_url_of_this_machine_is_refused_like_its_folder(url, tmp_path):
    made(url)
    Path("outside").mkdir()
    Path("linked").mkdir()
    Path("linked/data").symlink_to("../outside")
    before = sorted(Path().rglob("*"))
    for place, message in {"there/data/in": "lies within the dataset", "linked": "found a link"}.items():
        with pytest.raises(UsageError, match=message):
            made(f"file://{tmp_path}/{place}")
    assert sorted(Path().rglob("*")) == before


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
