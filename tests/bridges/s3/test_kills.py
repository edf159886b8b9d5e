"""A run into a bucket that is killed at any request: readers meet no mixture, and the same command heals."""

import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress

import boto3
import pyarrow.parquet as pq
import pytest
from pyarrow.fs import FileSelector, FileSystem

import ibdata
from ibdata.errors import IbdataError, UsageError

KILLS = 100 if os.environ.get("IBDATA_FAULTS") == "full" else 9
EXPERIMENT = """
name: killed
setpoints: [20, 70]
policies: [random, safe]
episodes: 5
steps: 20
output: {shard_rows: 40}
"""
KILLED = """
import os, signal, sys, threading
from ibdata._system.storage import Remote
from ibdata.cli import main

done, lock = [], threading.Lock()

def counting(name, method):
    def call(self, *args):
        with lock:
            done.append(name)
            if len(done) == int(sys.argv[1]):
                os.kill(os.getpid(), signal.SIGKILL)
        return method(self, *args)
    return call

for name in ("put", "copy_from", "remove", "size", "sizes", "names", "read"):
    setattr(Remote, name, counting(name, getattr(Remote, name)))
try:
    main(sys.argv[2:])
finally:
    print(len(done))
"""


def run(*args, kill_at=0):
    """A command, which is killed at its k-th request."""
    arguments = [sys.executable, "-c", KILLED, str(kill_at), *args]
    return subprocess.run(arguments, capture_output=True, text=True, timeout=300, check=False)


class Readers:
    """ibdata's reader, and one that reads whatever files there are, until the block ends."""

    def __init__(self, url, rows):
        self.url, self.rows, self.wrong, self.seen = url, rows, [], set()

    def __enter__(self):
        self._stop = threading.Event()
        self._threads = [
            threading.Thread(target=self._loop, args=(read,)) for read in (self._open, self._glob)
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *args):
        self._stop.set()
        for thread in self._threads:
            thread.join()

    def _loop(self, read):
        while not self._stop.wait(0.05):
            try:
                read()
            except Exception as error:
                self.wrong.append(repr(error))

    def _open(self):
        with suppress(IbdataError):
            rows = len(ibdata.open(self.url).table())
            self.seen.add(rows)
            if rows != self.rows:
                self.wrong.append(f"opened {rows} rows")

    def _glob(self):
        files, base = FileSystem.from_uri(self.url)
        found = files.get_file_info(FileSelector(f"{base}/data", allow_not_found=True))
        paths = [info.path for info in found if info.path.endswith(".parquet")]
        if paths:
            table = pq.ParquetDataset(paths, filesystem=files).read(columns=["episode", "step"])
            if len({*zip(*(column.to_pylist() for column in table.columns), strict=True)}) != len(table):
                self.wrong.append("a row twice")


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "killed.yaml"
    path.write_text(EXPERIMENT)
    return str(path)


def litter(bucket, name):
    """The objects in the part of a place, but for the marks that pyarrow leaves of empty folders."""
    objects = boto3.client("s3").list_objects_v2(Bucket=bucket, Prefix=f".{name}.part")
    return [each["Key"] for each in objects.get("Contents", []) if not each["Key"].endswith("/")]


def test_a_run_that_is_killed_at_any_request_goes_on(bucket, config):
    """Of a whole run, of a part of an array job and of finalize, in turn."""
    plain = ibdata.generate(config, "plain", workers=1)
    requests = {}
    for kind in ("whole", "part", "finalize"):
        url = f"s3://{bucket}/count-{kind}"
        steps = steps_of(kind, config, url)
        for step in steps:
            done = run(*step)
            assert done.returncode == 0, done.stderr
        requests[kind] = int(done.stdout.split()[-1])
    print("requests", requests, "of", len(plain.manifest["shards"]), "shards")
    for number in range(KILLS):
        kind = ("whole", "part", "finalize")[number % 3]
        url = f"s3://{bucket}/x{number}"
        *before, last = steps_of(kind, config, url)
        for step in before:
            assert run(*step).returncode == 0
        at = 1 + number // 3 * requests[kind] * 3 // KILLS
        with Readers(url, 400) as readers:
            assert run(*last, kill_at=at).returncode == -signal.SIGKILL, (kind, at)
            healed = run(*last)
            assert healed.returncode == 0, healed.stderr
            if kind == "part":
                for step in (steps_of("finalize", config, url)[0], ("finalize", url)):
                    assert run(*step).returncode == 0
        assert readers.wrong == []
        assert ibdata.validate(url) == []
        assert ibdata.open(url).content_root == plain.content_root
        assert litter(bucket, f"x{number}") == []


def steps_of(kind, config, url):
    whole = ("generate", config, "--out", url, "--workers", "1", "--quiet")
    first, second = ((*whole, "--shards", f"{i}/2") for i in (1, 2))
    return {"whole": [whole], "part": [second, first][1:], "finalize": [second, first, ("finalize", url)]}[
        kind
    ]


def test_array_jobs_run_at_once_and_one_host_dies(bucket, config):
    """Between a shard and its receipt, perhaps; another host makes the same part."""
    url = f"s3://{bucket}/array"
    command = ("generate", config, "--out", url, "--workers", "1", "--quiet", "--shards")
    jobs = [
        subprocess.Popen([sys.executable, "-c", KILLED, at, *command, part], stdout=subprocess.DEVNULL)
        for at, part in (("20", "1/2"), ("0", "2/2"), ("0", "1/1"))
    ]
    assert [job.wait(120) for job in jobs] == [-signal.SIGKILL, 0, 0]
    assert run("finalize", url).returncode == 0
    assert ibdata.open(url).content_root == ibdata.generate(config, "plain", workers=1).content_root
    assert ibdata.validate(url) == []


def test_of_two_experiments_at_one_place_one_is_published(bucket, config):
    url = f"s3://{bucket}/both"
    command = ("generate", config, "--out", url, "--workers", "1", "--quiet", "--seed")
    jobs = [
        subprocess.Popen(
            [sys.executable, "-c", KILLED, "0", *command, seed], stderr=subprocess.PIPE, text=True
        )
        for seed in "12"
    ]
    said = [job.communicate(timeout=120)[1] for job in jobs]
    codes = sorted(job.returncode for job in jobs)
    assert codes[0] == 0
    assert codes[1] in (2, 75), said
    assert ibdata.validate(url) == []


def test_a_whole_bucket_is_no_place(bucket):
    with pytest.raises(UsageError, match=rf"^s3://{bucket}: is a whole bucket, expected a name in it"):
        ibdata.generate("random", f"s3://{bucket}")
