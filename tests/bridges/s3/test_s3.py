"""Datasets in an object store: a local S3 server, and fsspec's file system in memory."""

import re
import subprocess
import sys

import boto3
import numpy as np
import pytest
from helpers import ROOT
from helpers.datasets import PLAIN
from helpers.pages import blocks

import ibdata
from ibdata._system.storage import Remote
from ibdata.errors import DatasetError


@pytest.fixture(params=["s3", "memory"])
def url(request, bucket):
    """A place in each kind of store."""
    return f"{request.param}://{bucket}/a/x"


def generate(place, **options):
    return ibdata.generate(PLAIN, place, workers=1, **options)


def test_what_is_written_is_read_again(url):
    made, plain, opened = generate(url), generate("plain"), ibdata.open(url)
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
    assert repr(opened) == f"<ibdata.Dataset {url}: 240 rows, 12 episodes>"


def test_the_first_rows_need_the_first_file_only(bucket, monkeypatch):
    generate(f"s3://{bucket}/x")
    read, plain = [], Remote.open
    monkeypatch.setattr(Remote, "open", lambda self, path: (read.append(path), plain(self, path))[1])
    dataset = ibdata.open(f"s3://{bucket}/x")
    assert next(dataset.iter_batches(batch_rows=5)).num_rows == 5
    assert read == ["meta/manifest.json", "meta/dataset.json", dataset.manifest["shards"][0]["path"]]


def test_no_bucket_and_no_dataset_are_an_error_of_one_line(bucket):
    for place in (f"s3://{bucket}-not/x", f"s3://{bucket}/nothing"):
        with pytest.raises(DatasetError):
            ibdata.open(place)


def test_the_commands_and_the_snippet_of_the_page(bucket, command, tmp_path):
    text = (ROOT / "docs/scale.md").read_text()
    lines = re.findall(r"`(ibdata [a-z]+ [^`]*s3://my-bucket[^`]*)`", text)
    assert [line.split()[1] for line in lines] == ["generate", "info", "head", "validate"]
    (snippet,) = (block for block in blocks(text, "python") if "s3://" in block)
    boto3.client("s3").create_bucket(Bucket="my-bucket")
    for args in (*([command, *line.split()[1:]] for line in lines), [sys.executable, "-c", snippet]):
        done = subprocess.run(args, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
