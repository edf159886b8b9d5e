"""Datasets at URLs in pyarrow's local file system; scripts/bridges tests S3 and fsspec's file systems."""

from __future__ import annotations

import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from helpers.at_url import made

import ibdata
from ibdata.dataset import manifest
from ibdata.errors import DatasetError, UsageError


def test_the_same_files_are_there_as_in_a_folder(url):
    at_url, plain = made(url), made("plain")
    files, others = (
        {str(p.relative_to(folder)): p.read_bytes() for p in Path(folder).rglob("*") if p.is_file()}
        for folder in ("there", "plain")
    )
    assert set(files) == {file["path"] for file in at_url.manifest["files"]} | {
        manifest.CARD,
        manifest.PATH,
        manifest.SPLITS,
    }
    shards = [sorted(data for path, data in found.items() if "data/" in path) for found in (files, others)]
    assert shards[0] == shards[1]
    assert at_url.table().equals(plain.table())
    assert at_url.place == url


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


def test_a_dataset_at_a_url_has_no_folder(url):
    dataset = made(url)
    for path in (lambda: dataset.path, lambda: Path(dataset)):
        with pytest.raises(UsageError, match=f"^{url}: found a URL, expected a path on this machine$"):
            path()


def test_a_missing_file_at_a_url_is_not_said_to_be_made_by_repair(url):
    made(url)
    Path("there/meta/statistics.json").unlink()
    (problem,) = ibdata.validate(url, quick=True)
    assert problem.message == "found no file that can be read"
    with pytest.raises(DatasetError, match=f"^{url}/meta/statistics.json: missing$"):
        ibdata.open(url).statistics()


def test_a_url_of_this_machine_is_refused_like_its_folder(url, tmp_path):
    made(url)
    with pytest.raises(UsageError, match="lies within the dataset"):
        made(f"file://{tmp_path}/there/data/in")
    assert not Path("there/data/in").exists()
