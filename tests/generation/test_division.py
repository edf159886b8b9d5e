"""How shards are divided among processes and threads, and what several threads make."""

import threading
import time

import pytest
from helpers.tiny import FOUR_SHARDS
from ibdata.generation.division import divide

import ibdata
from ibdata.errors import IbdataError, Interrupted
from ibdata.experiment import Experiment
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import Shard
from ibdata.generation import division, make_shard


def spec_of(rows):
    """The spec of a dataset of so many rows, in shards of a million."""
    experiment = Experiment.model_validate(
        {"name": "x", "setpoints": 70, "policies": [{"kind": "random"}], "episodes": rows // 1000}
    )
    return DatasetSpec.of(experiment)


@pytest.mark.parametrize(
    ("rows", "processors", "workers", "expected"),
    [
        (10**6, 1, None, (1, 1)),
        (10**6, 64, None, (1, 4)),
        (10**7, 2, None, (1, 2)),
        (10**9, 4, None, (1, 4)),
        (10**7, 64, None, (1, 4)),
        (10**8, 64, None, (64, 1)),
        (10**8, 2, 1, (1, 2)),
        (10**8, 2, 2, (2, 1)),
        (10**8, 8, 2, (2, 4)),
        (2 * 10**6, 8, 16, (2, 4)),
    ],
)
def test_the_division_follows_from_rows_processors_and_workers(
    monkeypatch, rows, processors, workers, expected
):
    monkeypatch.setattr(division, "available_processors", lambda: processors)
    spec = spec_of(rows)
    assert divide(spec, spec.shards, workers) == expected


@pytest.mark.parametrize(("workers", "processes"), [(None, 8), (1, 1), (3, 3)])
def test_custom_policies_run_in_one_thread_of_each_process(monkeypatch, workers, processes):
    monkeypatch.setattr(division, "available_processors", lambda: 8)
    monkeypatch.setattr(division, "customs", lambda spec: ["mine:Mine"])
    spec = spec_of(10**8)
    assert divide(spec, spec.shards, workers) == (processes, 1)


@pytest.fixture
def tiny(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return FOUR_SHARDS


@pytest.fixture
def four_processors(monkeypatch):
    monkeypatch.setattr(division, "available_processors", lambda: 4)


def test_several_threads_make_the_content_and_files_of_one(tiny, four_processors, monkeypatch, files):
    running, most = set(), []
    write_shard = make_shard.write_shard

    def counted(spec, shard: Shard, *rest):
        running.add(shard.number)
        most.append(len(running))
        try:
            return write_shard(spec, shard, *rest)
        finally:
            running.discard(shard.number)

    monkeypatch.setattr("ibdata.generation.local.write_shard", counted)
    ibdata.generate(tiny, "several")
    assert max(most) > 1
    monkeypatch.setattr(division, "available_processors", lambda: 1)
    ibdata.generate(tiny, "one")
    assert files("several") == files("one")


def test_an_error_in_one_thread_ends_the_others(tiny, four_processors, monkeypatch):
    started, simulated = threading.Barrier(4, timeout=20), make_shard.simulated

    def failing(spec, shard):
        started.wait()  # until each of the four has its thread
        if shard.number == 2:
            raise OSError(28, "No space left on device")
        for made in simulated(spec, shard):
            time.sleep(0.3)  # until the other thread has failed
            yield made

    monkeypatch.setattr(make_shard, "simulated", failing)
    with pytest.raises(IbdataError, match="No space left on device"):
        ibdata.generate(tiny, "out")
    assert not [each for each in threading.enumerate() if "ThreadPool" in each.name]


def test_a_shard_that_is_told_to_stop_ends_between_two_parts(tiny, tmp_path):
    stopped = threading.Event()
    stopped.set()
    spec = DatasetSpec.of(tiny)
    with pytest.raises(Interrupted):
        make_shard.write_shard(spec, spec.shards[0], tmp_path, "0", True, stopped)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
