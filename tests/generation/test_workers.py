"""Several worker processes: equal files, errors that reach the caller, and no leftovers if a worker ends."""

from __future__ import annotations

import errno
import multiprocessing
import os
import subprocess
import sys
import textwrap
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager

import pytest
from helpers.python import python

import ibdata
from ibdata import Experiment

pytestmark = pytest.mark.slow  # a process starts in more than a second

PLAIN = {
    "name": "tiny",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "random"}, {"kind": "safe"}],
    "episodes": 2,
    "steps": 30,
    "output": {"shard_rows": 60},
}

SCRIPT = """
    import sys
    import ibdata
    import changing
    from ibdata.generation import worker_pool
    from ibdata.experiment import Experiment

    worker_pool._start = changing.start
    experiment = Experiment.model_validate({plain})
    try:
        made = ibdata.generate(experiment, "a/b", workers=2)
        print("made", made.content_root)
    except Exception as error:
        print("failed", type(error).__name__, isinstance(error, ibdata.IbdataError), error, sep=": ")
    loaded = [name for name in ("pandas", "polars", "duckdb", "matplotlib") if name in sys.modules]
    print("loaded", *loaded)
"""
CHANGING = """
    import os
    import ibdata.writing.summary as content
    from ibdata.policies.checked import PolicyError
    from ibdata.generation import worker_pool

    rollout, begin = content.rollout, worker_pool._start

    def changed(experiment, first, stop):
        {changed}

    def start(*args):  # what a worker does first
        content.rollout = changed
        begin(*args)
"""


@pytest.fixture
def run(tmp_path):
    """Run a script that generates into a/b with two workers, in which `changed` fills the columns."""

    def script(changed="return rollout(experiment, first, stop)"):
        path = tmp_path / "script.py"
        path.write_text(textwrap.dedent(SCRIPT).format(plain=PLAIN))
        (tmp_path / "changing.py").write_text(textwrap.dedent(CHANGING).format(changed=changed))
        child = python("-B", "-W", "error", path, cwd=tmp_path)
        assert child.returncode == 0, child.stderr
        assert "Traceback" not in child.stderr
        return child.stdout.splitlines()

    return script


PLAIN_SCRIPT = f"""
import ibdata

print("made", ibdata.generate(ibdata.Experiment.model_validate({PLAIN}), "out", workers=2).content_root)
"""
WAYS = {
    "a script": ["plain.py"],
    "through stdin": ["-"],
    "-c": ["-c", PLAIN_SCRIPT],
    "-m": ["-m", "package.module"],
    "a folder": ["package"],
}


@pytest.mark.parametrize("way", WAYS)
def test_code_without_a_main_guard_runs_once_and_with_several_workers(way, alone, tmp_path):
    for path in ("plain.py", "package/module.py", "package/__main__.py"):
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(PLAIN_SCRIPT)
    child = subprocess.run(
        [sys.executable, "-W", "error", *WAYS[way]],
        input=PLAIN_SCRIPT if way == "through stdin" else None,
        cwd=tmp_path, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert (child.stdout, child.stderr) == (f"made {alone.content_root}\n", "")


def test_a_process_that_may_have_no_children_does_the_work_itself(alone, tmp_path):
    script = tmp_path / "daemon.py"
    begin = "process = multiprocessing.get_context('fork').Process(target=main, daemon=True)"
    body = "".join(f"    {line}\n" for line in PLAIN_SCRIPT.splitlines())
    script.write_text(
        f"import multiprocessing\ndef main():\n{body}\n{begin}\nprocess.start()\nprocess.join()\n"
    )
    child = subprocess.run(
        [sys.executable, script], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert (child.stdout, child.stderr) == (f"made {alone.content_root}\n", "")


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    experiment = Experiment.model_validate(PLAIN)
    return ibdata.generate(experiment, tmp_path_factory.mktemp("one") / "out", workers=1)


def test_two_workers_make_the_files_of_one(alone, tmp_path):
    other = ibdata.generate(Experiment.model_validate(PLAIN), tmp_path / "two", workers=2)
    assert other.content_root == alone.content_root
    assert len(alone.manifest["shards"]) == 4
    for a, b in zip(alone.manifest["shards"], other.manifest["shards"], strict=True):
        assert {**a, "path": None} == {**b, "path": None}
        assert (alone.path / a["path"]).read_bytes() == (other.path / b["path"]).read_bytes()
    names = [file["path"] for file in alone.manifest["files"] if not file["path"].startswith("data/")]
    for name in names:
        assert (alone.path / name).read_bytes() == (other.path / name).read_bytes()


def test_a_script_may_use_two_workers_and_loads_no_reader(run, alone):
    assert run() == [f"made {alone.content_root}", "loaded"]


def test_an_error_of_a_worker_reaches_the_caller_as_it_was(run, tmp_path):
    lines = run("raise PolicyError(f'policy odd: episode {first}: step 3: found nothing')")
    assert lines[0].startswith("failed: PolicyError: True: policy odd: episode ")
    assert lines[0].endswith(": step 3: found nothing")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["changing.py", "script.py"]


def test_a_refusal_of_the_system_in_a_worker_is_an_error_of_one_line(run, tmp_path):
    lines = run("raise OSError(28, 'No space left on device')")
    assert lines[0] == "failed: IbdataError: True: a/b: cannot be written: No space left on device"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["changing.py", "script.py"]


def test_a_worker_that_is_killed_is_an_error_of_one_line(run, tmp_path):
    lines = run("os._exit(9) if first == 4 else None; return rollout(experiment, first, stop)")
    assert lines[0] == (
        "failed: IbdataError: True: three worker processes died in a row, probably out of memory; "
        "run again with resume=True and fewer workers=…"
    )
    assert not list(tmp_path.rglob(".tmp-*"))


HALF = """import struct, sys
    frame = sys._getframe()
    while "result_queue" not in frame.f_locals:
        frame = frame.f_back
    frame.f_locals["result_queue"]._writer._send(struct.pack("!i", 1000))
    os._exit(9)
"""


def test_a_worker_that_is_killed_while_it_sends_its_result_is_no_reason_to_wait_forever(run, tmp_path):
    """The pool's own thread waits for the rest of the result, which nobody will send."""
    lines = run(HALF)
    assert lines[0].startswith("failed: IbdataError: True: three worker processes died in a row")


def test_all_workers_start_with_the_first_shard(monkeypatch, tmp_path, alone):
    """The pool closes all pipes when a worker ends, those with which another one is being started too."""
    submit, alive = ProcessPoolExecutor.submit, []

    def noted(self, *args):
        future = submit(self, *args)
        alive.append(len(multiprocessing.active_children()))
        return future

    monkeypatch.setattr(ProcessPoolExecutor, "submit", noted)
    made = ibdata.generate(Experiment.model_validate(PLAIN), tmp_path / "two", workers=2)
    assert (made.content_root, alive[0]) == (alone.content_root, 2)


def test_a_system_that_starts_no_worker_says_so(monkeypatch, tmp_path):
    def refused(self, *args):
        raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr(ProcessPoolExecutor, "submit", refused)
    with pytest.raises(ibdata.IbdataError, match=os.strerror(errno.EAGAIN)):
        ibdata.generate(Experiment.model_validate(PLAIN), tmp_path / "two", workers=2)


def test_workers_write_nothing_after_the_caller_has_failed(monkeypatch, tmp_path):
    """The bar fails at the first shard, while others are under way; the folder existed before."""

    @contextmanager
    def broken(*args):
        def fail(units):
            if units:
                raise KeyboardInterrupt

        yield fail

    folder = tmp_path / "existing"
    folder.mkdir()
    slow = {"episodes": 2, "steps": 5000, "output": {"shard_rows": 1}}
    experiment = Experiment.model_validate({**PLAIN, **slow})
    monkeypatch.setattr("ibdata.generation.generate.bar", broken)
    with pytest.raises(KeyboardInterrupt) as error:
        ibdata.generate(experiment, folder, workers=2)
    del error  # with the traceback go the workers
    left = sorted(folder.rglob("*"))
    assert not [path for path in left if path.name.startswith(".tmp-")]
    time.sleep(0.5)
    assert sorted(folder.rglob("*")) == left
