"""A worker of Ray, without Ray: it makes the shards of the experiment that it is given."""

from __future__ import annotations

from ibdata.experiment import load
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.generation import ray
from ibdata.generation.process import WorkerTask


def test_another_run_at_the_same_place_is_another_run(tmp_path, monkeypatch):
    seeds = []
    monkeypatch.setattr(ray, "agree", lambda spec, root: None)
    monkeypatch.setattr(ray, "make_shard", lambda spec, *rest: seeds.append(spec.experiments[0].seed))
    monkeypatch.setattr("ibdata._system.processes.purpose", "test")
    for seed in (1, 2, 2):
        plain = {"name": "x", "setpoints": 70, "policies": ["random"], "steps": 2, "seed": seed}
        spec = DatasetSpec.of(load(plain))
        task = WorkerTask(spec, tmp_path, tmp_path)
        ray._work(task, spec.shards[0])
    assert seeds == [1, 2, 2]
