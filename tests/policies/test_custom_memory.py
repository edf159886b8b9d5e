"""Custom policies with memory give the same data whatever the files and workers."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from helpers import remembering

import ibdata
from ibdata.errors import PolicyError
from ibdata.experiment import load


@pytest.fixture
def make(mine):
    """Make a dataset of two policies, of which one remembers, in files of so many rows."""
    (mine / "remembering.py").write_text(inspect.getsource(remembering))

    def make(name, rows=100, workers=1, **options):
        block = {"kind": "custom", "target": f"remembering.py:{name}", **options}
        sticky = {"kind": "sticky", "base": block, "kappa": 0.3}
        plain = {"name": "x", "setpoints": [20, 70], "policies": [block, sticky], "episodes": 3, "steps": 12}
        experiment = load({**plain, "output": {"shard_rows": rows}})
        out = f"{name}-{rows}-{workers}"
        return ibdata.generate(experiment, out, workers=workers, allow_code=True)

    return make


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("Centred", {"draws": 3, "params": {"theta": 0.3}}),
        ("Resetting", {"draws": 3}),
    ],
)
def test_the_root_is_the_same_over_files_workers_and_repair(make, shard_file, name, options):
    together, apart = make(name, **options), make(name, rows=36, workers=2, **options)
    assert together.content_root == apart.content_root
    assert (len(together.manifest["shards"]), len(apart.manifest["shards"])) == (2, 4)
    lost = shard_file(apart.path, 2)
    (apart.path / lost).unlink()
    assert ibdata.repair(apart.path, workers=1, allow_code=True) == [lost]
    known = np.isfinite(apart.to_pandas()["action_log_prob"])
    assert known.any() == (name != "Resetting")


@pytest.mark.usefixtures("make")
def test_the_options_must_give_what_an_object_needs():
    line = "found draws: 0, expected at least the needs of Centred; write draws: 3"
    with pytest.raises(PolicyError, match=line):
        ibdata.evaluate({"kind": "custom", "target": "remembering.py:Centred"}, steps=2, episodes=2)
