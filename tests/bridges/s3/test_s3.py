"""Datasets in an object store: a local S3 server, and fsspec's file system in memory."""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
from pathlib import Path

import boto3
import numpy as np
import pytest
from moto.server import ThreadedMotoServer

import ibdata
from ibdata import Experiment, IbdataError
from ibdata.errors import DatasetError, UsageError
from ibdata.system import storage
from ibdata.system.storage import Remote

ROOT = Path(__file__).parents[3]
NUMBERS = itertools.count()
PLAIN = {
    "name": "tiny",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "random"}],
    "episodes": 4,
    "steps": 50,
    "output": {"shard_rows": 100},
}


UNLISTED = ("README.md", "meta/manifest.json", "meta/splits.json")


def listed_in(dataset):
    """The paths of the files that the manifest lists."""
    return [file["path"] for file in dataset.manifest["files"]]


@pytest.fixture(scope="module")
def server():
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    yield f"http://{host}:{port}"
    server.stop()


@pytest.fixture
def bucket(server, tmp_path, monkeypatch):
    """A new bucket."""
    settings = {"AWS_ENDPOINT_URL": server, "AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test"}
    settings |= {"AWS_DEFAULT_REGION": "us-east-1", "AWS_EC2_METADATA_DISABLED": "true"}
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(tmp_path)
    client = boto3.client("s3")
    name = f"bucket-{next(NUMBERS)}"
    client.create_bucket(Bucket=name)
    return name


@pytest.fixture
def objects(bucket):
    """The names of the objects in the bucket."""
    return lambda: [
        o["Key"]
        for o in boto3.client("s3").list_objects_v2(Bucket=bucket).get("Contents", [])
        if not o["Key"].endswith("/")  # pyarrow marks folders
    ]


@pytest.fixture
def tiny():
    return Experiment.model_validate(PLAIN)


@pytest.mark.parametrize("scheme", ["s3", "memory"])
def test_what_is_written_is_read_again(bucket, tiny, scheme):
    url = f"{scheme}://{bucket}/a/x"
    made = ibdata.generate(tiny, url, workers=1)
    plain = ibdata.generate(tiny, "plain", workers=1)
    opened = ibdata.open(url)
    assert opened.content_root == made.content_root == plain.content_root
    assert (opened.manifest, opened.info) == (made.manifest, plain.info)
    for one, other in zip(opened.manifest["shards"], plain.manifest["shards"], strict=True):
        assert {**one, "path": None} == {**other, "path": None}
    assert opened.statistics() == plain.statistics()
    assert opened.table().equals(plain.table())
    assert opened.to_pandas(["reward"]).equals(plain.to_pandas(["reward"]))
    for name, array in opened.arrays(history=3).items():
        np.testing.assert_array_equal(array, plain.arrays(history=3)[name])
    assert ibdata.validate(url) == []
    assert repr(opened) == f"<ibdata.Dataset {url}: 400 rows, 8 episodes>"


def test_the_first_rows_need_the_first_file_only(bucket, tiny, monkeypatch):
    ibdata.generate(tiny, f"s3://{bucket}/x", workers=1)
    read, plain = [], storage.Remote.open
    monkeypatch.setattr(storage.Remote, "open", lambda self, path: (read.append(path), plain(self, path))[1])
    dataset = ibdata.open(f"s3://{bucket}/x")
    assert next(dataset.iter_batches(batch_rows=5)).num_rows == 5
    assert read == ["meta/manifest.json", "meta/dataset.json", dataset.manifest["shards"][0]["path"]]


def test_nothing_but_the_dataset_is_left_there_and_nothing_here(bucket, tiny, objects, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("IBDATA_CACHE_DIR", raising=False)
    made = ibdata.generate(tiny, f"s3://{bucket}/x", workers=1)
    assert sorted(objects()) == sorted(f"x/{path}" for path in [*listed_in(made), *UNLISTED])
    assert list(tmp_path.rglob("*.parquet")) == []


@pytest.mark.parametrize("call", range(11))
@pytest.mark.parametrize("torn", [False, True])
def test_an_upload_that_fails_shows_nothing_and_is_resumed(bucket, tiny, objects, monkeypatch, call, torn):
    url, calls, put = f"s3://{bucket}/x", iter(range(100)), Remote.put

    def failing(self, source, path):
        if next(calls) == call:
            if torn:
                Path("part").write_bytes(source.read_bytes()[:-7])
                put(self, Path("part"), path)
            raise OSError("connection lost")
        put(self, source, path)

    with monkeypatch.context() as broken:
        broken.setattr(Remote, "put", failing)
        message = "cannot be written: connection lost; --resume tries again$"
        with pytest.raises(IbdataError, match=message):
            ibdata.generate(tiny, url, workers=1)
    with pytest.raises(DatasetError, match=r"no finished dataset|no valid JSON"):
        ibdata.open(url)
    uploaded = []
    monkeypatch.setattr(Remote, "put", lambda self, s, path: (uploaded.append(path), put(self, s, path)))
    made = ibdata.generate(tiny, url, workers=1, resume=True)
    assert made.content_root == ibdata.generate(tiny, "plain", workers=1).content_root
    assert ibdata.validate(url) == []
    assert len(uploaded) == 11  # all again


@pytest.mark.parametrize("scheme", ["s3", "memory"])
def test_a_place_with_other_files_is_refused_and_left_as_it_is(bucket, tiny, scheme):
    url = f"{scheme}://{bucket}/a/x"
    remote = Remote(url)
    Path("own.parquet").write_bytes(b"mine")
    remote.put(Path("own.parquet"), "data/own.parquet")
    for options in ({}, {"resume": True}):
        with pytest.raises(UsageError, match=r"holds files, but no finished dataset, such as data/own\.parq"):
            ibdata.generate(tiny, url, workers=1, **options)
    assert remote.sizes() == {"data/own.parquet": 4}
    remote.remove("data/own.parquet")
    made = ibdata.generate(tiny, url, workers=1)
    assert set(remote.sizes()) == {*listed_in(made), *UNLISTED}
    remote.put(Path("own.parquet"), "data/own.parquet")
    assert [problem.path for problem in ibdata.validate(url)] == ["data/own.parquet"]


def test_a_server_that_breaks_off_is_an_error_of_one_line(bucket, tiny):
    ibdata.generate(tiny, f"s3://{bucket}/x", workers=1)
    dataset = ibdata.open(f"s3://{bucket}/x")
    shard = dataset.manifest["shards"][2]["path"]
    boto3.client("s3").delete_object(Bucket=bucket, Key=f"x/{shard}")
    with pytest.raises(DatasetError, match=f"{re.escape(shard)}: cannot be read"):
        dataset.table()
    (problem,) = ibdata.validate(f"s3://{bucket}/x")
    assert (problem.path, problem.rule) == (shard, "file")


def test_what_is_there_is_not_written_over(bucket, tiny, objects):
    url = f"s3://{bucket}/x"
    ibdata.generate(tiny, url, workers=1)
    before = objects()
    for options, line in (
        ({"seed": 1, "resume": True}, "holds the dataset of another experiment"),
        ({"overwrite": True}, "overwrite=True is for folders"),
    ):
        with pytest.raises(UsageError, match=f"^{url}: {line}"):
            ibdata.generate(tiny, url, workers=1, **options)
    assert ibdata.generate(tiny, url, workers=1, resume=True).manifest == ibdata.open(url).manifest
    boto3.client("s3").put_object(Bucket=bucket, Key="mine/notes.txt", Body=b"mine")
    with pytest.raises(UsageError, match="holds files, but no finished dataset"):
        ibdata.generate(tiny, f"s3://{bucket}/mine", workers=1)
    assert objects() == ["mine/notes.txt", *before]


def test_no_bucket_is_an_error_of_one_line(bucket, ibdata):
    for args in (["info", f"s3://{bucket}-not/x"], ["info", f"s3://{bucket}/nothing"]):
        done = ibdata(*args)
        assert (done.returncode, done.stderr.count("\n")) == (3, 1), done.stderr
        assert "Traceback" not in done.stderr


def test_ranges_and_folders_of_experiments_need_a_folder(bucket, tiny):
    with pytest.raises(UsageError, match="found a URL with --shards, expected a folder"):
        ibdata.generate(tiny, f"s3://{bucket}/x", shards="1/2")
    with pytest.raises(UsageError, match="found a URL for a folder of experiments, expected a folder"):
        ibdata.generate("siemens-offline", f"s3://{bucket}/x")


def test_the_commands_and_the_snippet_of_the_page(bucket, command, tmp_path):
    text = (ROOT / "docs/scale.md").read_text()
    lines = re.findall(r"`(ibdata [a-z]+ [^`]*s3://my-bucket[^`]*)`", text)
    assert [line.split()[1] for line in lines] == ["generate", "info", "head", "stats", "validate"]
    (snippet,) = (
        block for block in re.findall(r"^```python\n(.*?)^```$", text, re.M | re.S) if "s3://" in block
    )
    boto3.client("s3").create_bucket(Bucket="my-bucket")
    (tmp_path / "snippet.py").write_text(snippet)
    for args in (*(line.split() for line in lines), ["python", "snippet.py"]):
        args[0] = {"ibdata": command, "python": sys.executable}[args[0]]
        done = subprocess.run(args, capture_output=True, text=True, timeout=120, env=dict(os.environ))
        assert done.returncode == 0, done.stderr
