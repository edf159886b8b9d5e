"""The list of datasets below a folder."""

import os
from pathlib import Path

import pytest
from helpers.tiny import FOUR_SHARDS

import ibdata
from ibdata.errors import UsageError
from ibdata.maintenance.listing import datasets_in

EXPERIMENT = {"name": "x", "setpoints": [20, 70], "policies": ["random", "safe"], "steps": 3}


def test_datasets_of_every_state_are_found(made_at, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = made_at(EXPERIMENT, "data/set/b")
    made_at(EXPERIMENT, "data/damaged")
    Path("data/damaged/meta/manifest.json").write_text("{}")
    ibdata.generate(FOUR_SHARDS, "data/begun", shards="1/4", workers=1)
    ibdata.generate(FOUR_SHARDS, "data/lost", shards="3/4", workers=1)
    Path("data/.lost.part/experiment.yaml").unlink()
    Path("other/.x.part").mkdir(parents=True)
    os.symlink("data", "link")
    made_at(EXPERIMENT, ".hidden/a")
    found = {str(each.path): each for each in datasets_in(".")}
    assert list(found.items()) == sorted(found.items())
    assert {path: each.state for path, each in found.items()} == {
        "data/begun": "unfinished, 1 of 4 shards",
        "data/damaged": "damaged",
        "data/lost": "unfinished, damaged",
        "data/set/b": "finished",
    }
    finished, begun = found["data/set/b"], found["data/begun"]
    assert (finished.name, finished.rows, finished.setpoints, finished.policies, finished.content_root) == (
        "x", 12, [20.0, 70.0], ["random", "safe"], made.content_root
    )  # fmt: skip
    assert finished.bytes == sum(file["bytes"] for file in made.manifest["files"])
    assert (begun.name, begun.rows, begun.setpoints, begun.content_root) == ("tiny", None, [20.0, 70.0], None)
    assert begun.bytes > 0
    assert [each.path for each in datasets_in("data/set/b")] == [Path("data/set/b")]
    assert datasets_in("other") == []
    with pytest.raises(UsageError, match="found no folder here"):
        datasets_in("nowhere")
