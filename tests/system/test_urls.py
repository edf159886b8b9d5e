"""Datasets at URLs, in pyarrow's local file system: what reads them, what refuses them, and no credentials.

scripts/bridges tests S3 and the file systems of fsspec.
"""

import shutil
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.datasets import four_shards_at
from helpers.folders import contents
from helpers.refusals import refused
from helpers.splits import HALVES
from pyarrow.fs import FileSystem

import ibdata
import ibdata.plots
from ibdata._system import storage
from ibdata._system.storage import is_url
from ibdata.cli import cli
from ibdata.errors import DatasetError, IbdataError
from ibdata.experiment.catalogue import write_template
from ibdata.tools.card import card

READERS = ("info", "head", "stats", "validate")


def test_a_scheme_of_two_letters_and_two_slashes_make_a_url():
    assert all(map(is_url, ["s3://a/b", "memory://x", "file:///x", "S3://a/b", "abfs+x://y"]))
    assert not any(map(is_url, ["s3:/a/b", "a/b", "/s3://x", "://x", "c://x", Path("s3://a"), None, ""]))


def said(*args):
    """What a command prints, on both streams."""
    done = CliRunner().invoke(cli, list(args), catch_exceptions=False)
    assert done.exit_code == 0
    return done.output


def test_a_reading_command_says_the_same_of_a_url(url):
    four_shards_at(url)
    for command in READERS:
        assert said(command, url).replace(url, "there") == said(command, "there")


def test_damage_is_found_and_named(url, shard_file):
    four_shards_at(url)
    shard = shard_file("there", 1)
    Path("there", shard).write_bytes(Path("there", shard).read_bytes()[:-1] + b"x")
    shutil.copy(Path("there", shard), "there/data/part-00009-00000000.parquet")
    Path("there/meta/statistics.json").unlink()
    found = {(problem.path, problem.rule) for problem in ibdata.validate(url, quick=True)}
    lost, strange = "meta/statistics.json", "data/part-00009-00000000.parquet"
    assert found == {(shard, "hash"), (strange, "file"), (lost, "file")}
    refused(f"^{url}/{lost}: missing$", ibdata.open(url).statistics, error=DatasetError)


# --- credentials

SECRETS = ("KEY", "SECRET", "TOKEN", "RET", "SEC")
URLS = {  # and how errors begin that name them
    "s3://KEY:SECRET@bucket/a/b?secret_key=TOKEN": "s3://…@bucket/a/b?secret_key=…: Unexpected",
    "s3://KEY:SEC/RET@bucket/a": "s3://…@bucket/a: Cannot parse URI: 's3://…@bucket/a'",
    "odd://KEY:SECRET@host/a?sig=TOKEN&region=eu": "odd:// needs the package fsspec: pip install fsspec, or",
}


@pytest.mark.parametrize("url", URLS)
def test_credentials_in_urls_are_in_no_error(url, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    if url.startswith("odd"):
        monkeypatch.setitem(sys.modules, "fsspec", None)
    calls = [ibdata.open, ibdata.validate, four_shards_at, ibdata.repair, ibdata.split]
    calls += [lambda url: ibdata.generate("random", url, shards="1/1")]
    calls += [lambda url: ibdata.merge([url, url], out="x")]
    calls += [lambda url: ibdata.generate("siemens-offline", out=url)]
    for i, call in enumerate(calls):
        with pytest.raises(IbdataError) as error:
            call(url)
        assert not any(secret in str(error.value) for secret in SECRETS)
        assert str(error.value).startswith(URLS[url]) or i > 2
    assert not Path("x").exists()


def test_credentials_in_urls_are_in_no_result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    four_shards_at("there")
    files = FileSystem.from_uri(tmp_path.as_uri())[0]
    monkeypatch.setattr(storage, "_file_system", lambda url: (files, str(tmp_path / "there")))
    url = "s3://KEY:SECRET@bucket/there?secret_key=TOKEN"
    dataset = ibdata.open(url)
    assert dataset.place == "s3://…@bucket/there?secret_key=…"
    assert repr(dataset).startswith("<ibdata.Dataset s3://…@bucket/there?secret_key=…: 20 rows")
    assert len(dataset.table()) == 20
    shown = [said(command, url, *more) for command in READERS for more in ([], ["--json"])]
    Path("there/meta/dataset.json").write_text("{}", encoding="utf-8")
    with pytest.raises(DatasetError) as error:
        _ = ibdata.open(url).info
    assert not any(secret in text for text in (*shown, str(error.value)) for secret in SECRETS)


# --- what takes no URL

WITHOUT_URLS = {
    "path": lambda url: ibdata.open(url).path,
    "fspath": lambda url: Path(ibdata.open(url)),
    "materialize": lambda url: ibdata.split("here", HALVES, materialize=url),
    "label": lambda url: ibdata.split(url, HALVES),
    "merge": lambda url: ibdata.merge(["here", "other"], url),
    "export": lambda url: ibdata.export("here", to="npz", out=url),
    "plot": lambda url: ibdata.plots.plot("here", out=url),
    "card": card,
    "repair": ibdata.repair,
    "reproduce": ibdata.reproduce,
    "template": lambda url: write_template(f"{url}.yaml"),
}


def test_functions_that_take_no_url_say_so(url):
    """Nor a dataset at one; and they write nothing."""
    dataset = four_shards_at(url)
    shutil.copytree("there", "here")
    ibdata.generate(TINY, "other", workers=1, seed=1)
    before = contents()
    for name, call in WITHOUT_URLS.items():
        as_dataset = name not in ("template", "path", "fspath")  # whose place is no dataset
        for place in (url, dataset) if as_dataset else (url,):
            refused(f"^{url}.*: found a URL, expected a path on this machine$", call, place)
    refused(f"^{url}: .* are also in {url}; leave one out", ibdata.merge, [url, url], "merged")
    assert contents() == before


# --- plug-ins, which may raise anything


class Broken:
    """A file system of which one method raises what no library promises."""

    def __init__(self, real, method):
        self._real, self._method = real, method

    def __getattr__(self, name):
        return self._raise if name == self._method else getattr(self._real, name)

    def _raise(self, *args, **options):
        raise RuntimeError("the plug-in failed\nin many lines")


BROKEN = {
    "open": ("open_input_file", lambda url: ibdata.open(url)),
    "list": ("get_file_info", lambda url: ibdata.validate(url)),
    "write": ("open_output_stream", lambda url: four_shards_at(f"{url}-new")),
    "list before writing": ("get_file_info", lambda url: four_shards_at(f"{url}-new")),
}


@pytest.mark.parametrize(("method", "call"), BROKEN.values(), ids=BROKEN)
def test_an_error_of_a_plug_in_is_one_line(url, monkeypatch, method, call):
    four_shards_at(url)
    files, base = FileSystem.from_uri(url)
    broken = Broken(files, method)
    found = lambda given: (broken, given.removeprefix(url).join([base, ""]))  # noqa: E731
    monkeypatch.setattr(storage, "_file_system", found)
    refused("^file://.*: .*the plug-in failed(;|$)", call, url, error=IbdataError)


def test_a_folder_that_goes_while_it_is_listed_is_empty(url):
    class Going:
        """The folder is removed between the look whether it is there and the list of what is in it."""

        calls = 0

        def get_file_info(self, selector):
            self.calls += 1
            if self.calls == 1:
                shutil.rmtree("there")
                raise FileNotFoundError(2, "Cannot list directory")
            return FileSystem.from_uri(url)[0].get_file_info(selector)

    four_shards_at(url)
    files = storage.storage(url)
    assert len(files.names("")) > 2
    files._files = Going()
    assert (files.names(""), files._files.calls) == ([], 2)
