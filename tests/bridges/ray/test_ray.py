"""The Ray engine gives the same dataset, survives killed workers, and stops all that it starts."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import boto3
import pytest
import ray
from helpers import ROOT
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.pages import blocks

import ibdata

pytestmark = pytest.mark.filterwarnings("ignore::FutureWarning:ray", "ignore::ResourceWarning")
POLICY = """
import os, signal, sys
from pathlib import Path


class Deadly:
    def __init__(self, driver, flag):
        self.driver, self.flag = driver, Path(flag)

    def act(self, history, u):
        of_ray = "ray" in sys.modules and os.getpid() != self.driver
        with self.flag.open("a+") as file:
            file.seek(0)
            if of_ray and len(file.read()) < 2:
                file.write("x")
                file.flush()
                os.kill(os.getpid(), signal.SIGKILL)
        return 2 * u[:, :3] - 1
"""


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def cluster():
    """A Ray that somebody else started."""
    ray.init("local", num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    yield ray.get_runtime_context().gcs_address
    ray.shutdown()


def processes(mark):
    """Processes whose environment has the mark."""
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            state = (path.parent / "stat").read_text().rsplit(")", 1)[1].split()[0]
            found += [path.parent.name] if mark.encode() in path.read_bytes() and state != "Z" else []
        except OSError:
            continue
    return found


def test_ray_makes_the_same_files_and_is_ended(files):
    made = ibdata.generate(TINY, "ray", workers=2, engine="ray")
    plain = ibdata.generate(TINY, "plain", workers=1)
    assert made.content_root == plain.content_root
    assert files("ray") == files("plain")
    assert not ray.is_initialized()


def test_the_command_runs_on_the_ray_at_an_address(cluster, ibdata):
    done = ibdata("generate", "-q", "--config", "random", "--engine", "ray", "--address", cluster)
    assert done.returncode == 0, done.stderr
    assert ray.cluster_resources()["CPU"] == 2


def test_a_killed_worker_costs_its_shard_only(cluster, tmp_path, files):
    Path("deadly.py").write_text(POLICY)
    params = {"driver": os.getpid(), "flag": str(tmp_path / "flag")}
    policy = {"kind": "custom", "target": "deadly:Deadly", "params": params, "draws": 3}
    experiment = {**TINY.plain(), "policies": [policy]}
    made = ibdata.generate(experiment, "ray", engine="ray", allow_code=True)
    assert (tmp_path / "flag").read_text() == "xx"
    plain = ibdata.generate(experiment, "plain", workers=1, allow_code=True)
    assert made.content_root == plain.content_root
    assert files("ray") == files("plain")


def test_a_signal_ends_it_and_the_ray_that_it_started(command):
    args = ["--config", "random", "--set", "episodes=40", "--set", "output.shard_rows=10000"]
    mark = f"IBDATA_MARK={os.getpid()}"
    run = subprocess.Popen(
        [command, "generate", "-q", *args, "--engine", "ray", "--workers", "1", "--out", "out"],
        env={**os.environ, "IBDATA_MARK": mark.partition("=")[2]},
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 100
    while not list(Path(".out.part/run/receipts").glob("*")) and time.monotonic() < deadline:
        time.sleep(0.01)
    run.send_signal(signal.SIGTERM)
    _, said = run.communicate(timeout=60)
    last = said.splitlines()[-1]  # Ray may log before it that the signal met it at work
    assert (run.returncode, last.partition(";")[0]) == (143, "ibdata: stopped by signal 15")
    assert not Path("out").exists()
    deadline = time.monotonic() + 30
    while processes(mark) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert processes(mark) == []
    whole = ibdata.generate("random", "out", overrides=args[3::2])
    assert ibdata.validate(whole.path, quick=True) == []


def test_an_address_without_a_ray_is_an_error_of_one_line(ibdata):
    done = ibdata("generate", "--config", "random", "--engine", "ray", "--address", "127.0.0.1:9")
    assert done.returncode == 1
    assert re.fullmatch(
        r"address: 127\.0\.0\.1:9: found no answer \(.*\), expected a running Ray; .*\n", done.stderr
    )
    assert not Path("data").exists()


def test_the_command_and_the_snippet_of_the_page(bucket, command):
    boto3.client("s3").create_bucket(Bucket="my-bucket")
    text = (ROOT / "docs/scale.md").read_text().partition("## Object stores")[0]
    (line,) = re.findall(r"`(ibdata generate [^`]*--engine ray[^`]*)`", text)
    (snippet,) = (block for block in blocks(text, "python") if "import ray\n" in block)
    for args in ([command, *line.split()[1:]], [sys.executable, "-c", snippet]):
        done = subprocess.run(args, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr


def test_shards_go_to_a_bucket_as_they_are_made(bucket):
    """Hosts that share no folder; a worker that dies, and code of a user, are as in a folder."""
    url = f"s3://{bucket}/x"
    made = ibdata.generate(TINY, url, engine="ray", workers=2)
    assert made.content_root == ibdata.generate(TINY, "plain", workers=1).content_root
    assert ibdata.validate(url) == []
    part = ibdata.generate(TINY, f"{url}-too", engine="ray", workers=2, shards="1/2")
    assert part.missing == 2
    ibdata.generate(TINY, f"{url}-too", workers=1, shards="2/2")
    assert ibdata.finalize(f"{url}-too").content_root == made.content_root
    Path("deadly.py").write_text(POLICY)
    options = {"driver": os.getpid(), "flag": str(Path("flag").absolute())}
    policy = {"kind": "custom", "target": "deadly:Deadly", "params": options, "draws": 3}
    experiment = {**TINY.plain(), "policies": [policy], "splits": {}}
    custom = ibdata.generate(experiment, f"{url}-own", engine="ray", workers=2, allow_code=True)
    assert Path("flag").read_text() == "xx"
    assert len(custom) == len(made)
