"""The list of datasets below a folder."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment
from ibdata.errors import UsageError
from ibdata.experiment import as_yaml
from ibdata.maintenance.listing import datasets_in

EXPERIMENT = Experiment.model_validate(
    {"name": "x", "setpoints": [20, 70], "policies": [{"kind": "random"}, {"kind": "safe"}], "steps": 3}
)


def test_datasets_are_found_in_all_states_and_nothing_else(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = ibdata.generate(EXPERIMENT, "data/set/b", workers=1)
    ibdata.generate(EXPERIMENT, "data/a", workers=1)
    ibdata.generate(EXPERIMENT, "data/damaged", workers=1)
    Path("data/damaged/meta/manifest.json").write_text("{}")
    Path("begun/.run").mkdir(parents=True)
    Path("begun/.run/experiment.yaml").write_bytes(as_yaml(EXPERIMENT))
    ibdata.generate(EXPERIMENT, "swapped", workers=1)
    Path("swapped/.new").mkdir()
    Path("swapped/.new/.ibdata-replacement").touch()
    Path("other/meta").mkdir(parents=True)
    os.symlink("data", "link")
    ibdata.generate(EXPERIMENT, ".hidden/a", workers=1)
    found = {str(each.path): each for each in datasets_in(".")}
    assert {path: each.state for path, each in found.items()} == {
        "begun": "unfinished",
        "data/a": "finished",
        "data/damaged": "damaged",
        "data/set/b": "finished",
        "swapped": "unsettled",
    }
    assert list(found) == sorted(found)
    finished, begun = found["data/set/b"], found["begun"]
    assert (finished.name, finished.rows, finished.setpoints, finished.policies, finished.content_root) == (
        "x", 12, [20.0, 70.0], ["random", "safe"], made.content_root
    )  # fmt: skip
    assert finished.bytes == sum(file["bytes"] for file in made.manifest["files"])
    assert (begun.rows, begun.setpoints, begun.content_root, begun.bytes) == (None, [20.0, 70.0], None, 0)
    assert [each.path for each in datasets_in("data/a")] == [Path("data/a")]
    assert datasets_in("other") == []


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(UsageError, match="found no folder here"):
        datasets_in(tmp_path / "nowhere")
