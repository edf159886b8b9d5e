"""Datasets in an object store: a local S3 server, and fsspec's file system in memory."""

import re
import subprocess
from contextlib import suppress
from pathlib import Path

import boto3
import numpy as np
import pytest
from helpers import ROOT
from helpers.datasets import PLAIN
from helpers.pages import blocks, check_guide

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


def section(name):
    """A section of the page, which is run in a folder of its own."""
    text = (ROOT / "docs/scale.md").read_text()
    return re.search(rf"^## {name}\n.*?(?=^## )", text, re.M | re.S)[0]


def test_the_code_of_the_page(bucket, tmp_path):
    boto3.client("s3").create_bucket(Bucket="my-bucket")
    check_guide(section("Object stores"), tmp_path)
    assert (
        ibdata.open("s3://my-bucket/safe-too").content_root == ibdata.open("s3://my-bucket/safe").content_root
    )


SBATCH = """#!/bin/sh
case "$*" in
*--wrap*) for last; do :; done; exec sh -ec "$last" >&2 ;;
esac
for SLURM_ARRAY_TASK_ID in $(seq "$(sed -n 's/^#SBATCH --array=1-//p' "$2")"); do
    export SLURM_ARRAY_TASK_ID
    sh -e "$2" >&2 || exit 1
done
echo 17
"""


def test_the_array_job_of_the_page(bucket, command, tmp_path, monkeypatch):
    """An sbatch that runs the tasks one after the other, and then the job that waits for them."""
    with suppress(boto3.client("s3").exceptions.BucketAlreadyOwnedByYou):
        boto3.client("s3").create_bucket(Bucket="my-bucket")
    array, submit = blocks(section("Several hosts"), "bash")
    (tmp_path / "array.sh").write_text(array)
    (tmp_path / "sbatch").write_text(SBATCH)
    (tmp_path / "sbatch").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{Path(command).parent}", prepend=":")
    subprocess.run(["sh", "-ec", submit], check=True, timeout=300)
    whole = ibdata.generate("drifting", "whole", overrides=["output.shard_rows=5000"])
    assert ibdata.open("s3://my-bucket/array").content_root == whole.content_root


def test_a_whole_bucket_is_listed(bucket, command):
    """Its datasets and unfinished runs; there is no folder around it."""
    generate(f"s3://{bucket}/x")
    ibdata.generate(PLAIN, f"s3://{bucket}/y", workers=1, shards="1/2")
    done = subprocess.run([command, "ls", f"s3://{bucket}"], capture_output=True, text=True, check=True)
    rows = [line.split() for line in done.stdout.splitlines()[1:3]]
    assert [(row[0].rpartition("/")[0] if "part" in row[0] else row[0]) for row in rows] == [
        f"s3://{bucket}/.y.part",
        f"s3://{bucket}/x",
    ]
