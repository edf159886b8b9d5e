"""Datasets of data version 1, in which a policy did not see its burn-in, can be read but not made again."""

from __future__ import annotations

import numpy as np
import pytest

import ibdata
from ibdata.errors import DatasetError, UsageError
from ibdata.experiment import Experiment
from ibdata.experiment.dataset_spec import spec_in
from ibdata.maintenance.repair import repair
from ibdata.simulation.episodes import Episodes, Past
from ibdata.validation.rows import check_shard

PLAIN = {
    "name": "late",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "epsilon_greedy", "base": {"kind": "optimized"}, "epsilon": 0.3}],
    "start": {"burn_in": [3, 9]},
    "episodes": 2,
    "steps": 8,
}


def experiment(**changes):
    return Experiment.model_validate({**PLAIN, **changes})


@pytest.fixture
def old(tmp_path, monkeypatch):
    """A dataset as an ibdata of data version 1 made it."""
    begin = Episodes.begin

    def forgetful(self, draw, lanes, setpoints, history_length=0):
        state, _ = begin(self, draw, lanes, setpoints, history_length)
        return state, Past.of(state, history_length)

    with monkeypatch.context() as patch:
        patch.setattr(Episodes, "begin", forgetful)
        patch.setattr(Experiment, "data_version", 1)
        return ibdata.generate(experiment(), tmp_path / "old", workers=1)


@pytest.fixture
def new(tmp_path):
    return ibdata.generate(experiment(seed=1), tmp_path / "new", workers=1)


def versions(*datasets):
    return [dataset.manifest["data_version"] for dataset in datasets]


@pytest.mark.parametrize(
    ("changes", "version"),
    [
        ({}, 2),
        ({"start": "uniform"}, 1),
        ({"start": {"burn_in": [0, 0]}}, 1),
        ({"policies": [{"kind": "safe"}]}, 1),
        ({"policies": [{"kind": "safe"}, {"kind": "optimized"}]}, 2),
        ({"policies": [{"kind": "custom", "target": "a:b", "history": 2}]}, 2),
    ],
    ids=str,
)
def test_only_experiments_whose_bytes_changed_have_another_version(changes, version):
    assert experiment(**changes).data_version == version


def test_a_new_dataset_is_valid_and_made_again(new):
    assert versions(new) == [2]
    assert ibdata.validate(new.path) == []
    assert ibdata.reproduce(new.path) == (4, [])


def test_an_old_dataset_is_read_validated_and_exported(old, tmp_path):
    assert versions(old) == [1]
    assert ibdata.validate(old.path) == []
    ibdata.export(old, to="npz", out=tmp_path / "old.npz")
    with np.load(tmp_path / "old.npz") as arrays:
        assert len(arrays["rewards"]) == len(old) == 32


def test_the_densities_of_an_old_dataset_are_those_of_its_version(old):
    spec = spec_in(old.path, old.manifest_model)
    shard = spec.shards[0]
    path = old.path / old.manifest_model.shards[0].path
    assert check_shard(spec, shard, path, "x", 1)[1] == []
    assert {problem.rule for problem in check_shard(spec, shard, path, "x", 2)[1]} == {"density"}


def test_an_old_dataset_is_not_made_again_and_the_reason_is_one_line(old):
    with pytest.raises(DatasetError) as error:
        ibdata.reproduce(old.path)
    assert str(error.value) == (
        f"{old.path}: found data version 1, in which policies did not see the burn-in; this ibdata makes "
        f"version 2 of it and cannot make it again; use an ibdata before 0.9"
    )
    with pytest.raises(
        UsageError, match="data version 1, and this ibdata makes 2; overwrite=True to replace"
    ):
        ibdata.generate(experiment(), old.path, workers=1, resume=True)


def test_an_old_dataset_at_a_url_is_named_by_the_url(old):
    with pytest.raises(DatasetError, match=f"^{old.path.as_uri()}: found data version 1, in which"):
        ibdata.state_at(ibdata.open(old.path.as_uri()), 0, 0)


def test_a_damaged_shard_of_an_old_dataset_is_left_as_it_is(old):
    path = next((old.path / "data").iterdir())
    path.write_bytes(path.read_bytes()[:-9])
    before = path.read_bytes()
    with pytest.raises(DatasetError, match="cannot make it again"):
        repair(old.path)
    assert path.read_bytes() == before


def test_metadata_of_an_old_dataset_are_made_again(old):
    (old.path / "meta" / "stats.json").unlink()
    assert repair(old.path) == ["meta/stats.json"]
    assert ibdata.validate(old.path) == []


def test_an_old_dataset_keeps_its_version_in_copies(old, tmp_path):
    other = ibdata.generate(experiment(start="default"), tmp_path / "other", workers=1)
    copy = ibdata.split(old, by="episode", fractions=[0.5, 0.5], materialize=tmp_path / "copy")
    both = ibdata.merge([old.path, other.path], tmp_path / "both")
    assert versions(other, copy, both) == [1, 1, 1]
    assert ibdata.validate(copy.path) == ibdata.validate(both.path) == []


def test_an_old_dataset_is_not_merged_with_a_new_one(old, new, tmp_path):
    expected = (
        f"{old.path}: found data version 1, expected 2 as of the others; make it again with this ibdata"
    )
    with pytest.raises(UsageError) as error:
        ibdata.merge([new.path, old.path], tmp_path / "both")
    assert str(error.value) == expected
    assert not (tmp_path / "both").exists()
