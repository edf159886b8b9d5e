"""Several processes: the same files, errors that reach the caller, and nothing left where one ends."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment

PLAIN = {
    "name": "tiny",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "random"}, {"kind": "safe"}],
    "episodes": 2,
    "steps": 30,
    "output": {"shard_rows": 60},
}

SCRIPT = """
    import os, sys
    import ibdata
    from ibdata.experiment import Experiment

    if __name__ != "__main__":  # in a worker
        import ibdata.dataset.content as content
        from ibdata.asking import PolicyError
        rollout = content.rollout
        def changed(experiment, first, stop):
            {changed}
        content.rollout = changed

    if __name__ == "__main__":
        experiment = Experiment.model_validate({plain})
        try:
            made = ibdata.generate(experiment, "a/b", workers=2)
            print("made", made.content_root)
        except Exception as error:
            print("failed", type(error).__name__, isinstance(error, ibdata.IbdataError), error, sep=": ")
        loaded = [name for name in ("pandas", "polars", "duckdb", "matplotlib") if name in sys.modules]
        print("loaded", *loaded)
"""


@pytest.fixture
def run(tmp_path):
    """Run a script that generates into a/b with two workers, in which `changed` fills the columns."""

    def script(changed="return rollout(experiment, first, stop)"):
        path = tmp_path / "script.py"
        path.write_text(textwrap.dedent(SCRIPT).format(plain=PLAIN, changed=changed))
        child = subprocess.run(
            [sys.executable, "-W", "error", str(path)],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(Path(ibdata.__file__).parents[1])},
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert child.returncode == 0, child.stderr
        assert "Traceback" not in child.stderr
        return child.stdout.splitlines()

    return script


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    experiment = Experiment.model_validate(PLAIN)
    return ibdata.generate(experiment, tmp_path_factory.mktemp("one") / "out", workers=1)


def test_two_workers_make_the_files_of_one(alone, tmp_path):
    other = ibdata.generate(Experiment.model_validate(PLAIN), tmp_path / "two", workers=2)
    assert other.content_root == alone.content_root
    assert len(alone.manifest["shards"]) == 4
    assert other.manifest == alone.manifest
    for path in alone.path.rglob("*"):
        if path.is_file():
            assert (other.path / path.relative_to(alone.path)).read_bytes() == path.read_bytes()


def test_a_script_with_a_main_guard_may_use_two_workers_and_loads_no_reader(run, alone):
    assert run() == [f"made {alone.content_root}", "loaded"]


def test_an_error_of_a_worker_reaches_the_caller_as_it_was(run, tmp_path):
    lines = run("raise PolicyError(f'policy odd: episode {first}: step 3: found nothing')")
    assert lines[0].startswith("failed: PolicyError: True: policy odd: episode ")
    assert lines[0].endswith(": step 3: found nothing")
    assert [path.name for path in tmp_path.iterdir()] == ["script.py"]


@pytest.mark.slow
def test_a_refusal_of_the_system_in_a_worker_is_an_error_of_one_line(run, tmp_path):
    lines = run("raise OSError(28, 'No space left on device')")
    assert lines[0] == "failed: IbdataError: True: a/b: cannot be written: No space left on device"
    assert [path.name for path in tmp_path.iterdir()] == ["script.py"]


@pytest.mark.slow
def test_a_worker_that_is_killed_is_an_error_of_one_line(run, tmp_path):
    lines = run("os._exit(9) if first == 4 else None; return rollout(experiment, first, stop)")
    assert lines[0].startswith("failed: IbdataError: True: a/b/data/part-"), lines
    assert "found 3 dead worker processes in a row, expected none" in lines[0]
    assert not list(tmp_path.rglob(".tmp-*"))


def test_workers_write_nothing_after_the_caller_has_failed(monkeypatch, tmp_path):
    """The bar fails at the first shard, while others are under way; the folder existed before."""

    class Broken:
        def __init__(self, *args, **options):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *args):
            pass

        def update(self, n):
            raise KeyboardInterrupt

    folder = tmp_path / "existing"
    folder.mkdir()
    slow = {"episodes": 2, "steps": 5000, "output": {"shard_rows": 1}}
    experiment = Experiment.model_validate({**PLAIN, **slow})
    monkeypatch.setattr("ibdata.engines.generate.tqdm", Broken)
    with pytest.raises(KeyboardInterrupt) as error:
        ibdata.generate(experiment, folder, workers=2)
    del error  # with the traceback go the workers
    assert list(folder.iterdir()) == []
