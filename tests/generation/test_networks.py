"""Datasets of networks carry the weights, and need nothing else to be made and checked again."""

from __future__ import annotations

import shutil

import pytest
from helpers import networks
from ibdata.system.atomic_files import file_sha256

import ibdata
from ibdata import Experiment
from ibdata.dataset import manifest
from ibdata.errors import DatasetError
from ibdata.experiment import load
from ibdata.generation import output_folder
from ibdata.maintenance.repair import repair
from ibdata.policies import weights_file

YAML = """
name: learned
setpoints: [20, 70]
policies:
  - {kind: network, file: actor.safetensors}
  - {kind: gaussian, base: {kind: network, file: actor.safetensors}, scale: 0.2}
steps: 12
output: {shard_rows: 12}
"""


@pytest.fixture
def learned(tmp_path, monkeypatch):
    """An experiment whose weights are beside its YAML file, in another folder than the current one."""
    (tmp_path / "given").mkdir()
    (tmp_path / "given" / "actor.safetensors").write_bytes(networks.weights())
    (tmp_path / "given" / "learned.yaml").write_text(YAML)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "given" / "learned.yaml"


@pytest.fixture
def elsewhere(learned, monkeypatch):
    """A function that forgets all weights and removes the experiment, as on another machine."""

    def move():
        monkeypatch.setattr(weights_file, "_known", {})
        shutil.rmtree(learned.parent, ignore_errors=True)

    return move


@pytest.fixture
def made(learned):
    return ibdata.generate(learned, "made", workers=1)


def test_a_dataset_carries_its_weights_once(made):
    (path,) = (path for path in made.manifest_model.entries() if manifest.WEIGHTS.fullmatch(path))
    assert (made.path / path).read_bytes() == networks.weights()
    assert made.manifest_model.entries()[path].sha256 == file_sha256(made.path / path)


def test_it_is_made_and_checked_again_without_anything_else(made, elsewhere):
    elsewhere()
    assert ibdata.validate(made.path) == []
    assert ibdata.reproduce(made.path)[1] == []
    elsewhere()
    again = ibdata.generate(made.path / manifest.EXPERIMENT, "again", workers=1)
    assert again.content_root == made.content_root
    assert ibdata.difference(made, again) == []


@pytest.mark.parametrize("lost", ["data/*-*.parquet", "meta/statistics.json", "meta/manifest.json"])
def test_lost_files_are_made_again(made, elsewhere, lost):
    before = {path: path.read_bytes() for path in made.path.rglob("*") if path.is_file()}
    next(made.path.glob(lost)).unlink()
    elsewhere()
    assert repair(made.path)
    assert {path.name for path in before if path.suffix == ".safetensors"} <= {
        path.name for path in (made.path / "meta").iterdir()
    }
    assert ibdata.validate(made.path) == []


def test_lost_weights_are_named_and_can_be_copied_back(made, elsewhere):
    (path,) = (made.path / "meta").glob("policy-*.safetensors")
    content = path.read_bytes()
    path.unlink()
    elsewhere()
    assert "file: found no file" in str(ibdata.validate(made.path)[0])
    with pytest.raises(DatasetError, match="weights cannot be made again; copy the file with the SHA-256"):
        repair(made.path)
    path.write_bytes(content)
    assert ibdata.validate(made.path) == []


def test_ranges_and_finalize_need_no_file_of_the_user(learned, elsewhere):
    for i in (1, 2):
        ibdata.generate_shards(learned, f"{i}/2", "parts", workers=1)
    elsewhere()
    assert ibdata.validate(ibdata.finalize("parts").path) == []


def test_a_run_is_resumed_only_with_the_same_weights(learned, monkeypatch):
    ibdata.generate_shards(learned, "1/2", "made", workers=1)
    (learned.parent / "actor.safetensors").write_bytes(networks.weights(seed=1))
    with pytest.raises(ibdata.IbdataError, match="unfinished run of another experiment"):
        ibdata.generate(learned, "made", workers=1, resume=True)
    (learned.parent / "actor.safetensors").write_bytes(networks.weights())
    assert ibdata.validate(ibdata.generate(learned, "made", workers=1, resume=True).path) == []


def test_a_merged_dataset_carries_the_weights_of_both(made, learned, elsewhere):
    (learned.parent / "actor.safetensors").write_bytes(networks.weights(seed=1))
    other = ibdata.generate(learned, "other", workers=1, overwrite=True)
    assert any("sha256" in line for line in ibdata.difference(made, other))
    elsewhere()
    both = ibdata.merge([made.path, other.path], "both")
    assert len(list((both.path / "meta").glob("policy-*.safetensors"))) == 2
    elsewhere()
    assert ibdata.validate(both.path) == []


def test_a_replaced_dataset_loses_its_weights(made, learned):
    (learned.parent / "actor.safetensors").write_bytes(networks.weights(seed=1))
    ibdata.generate(learned, made.path, workers=1, overwrite=True)
    (path,) = (made.path / "meta").glob("policy-*.safetensors")
    assert path.read_bytes() == networks.weights(seed=1)
    assert list(made.path.rglob("policy-*.safetensors")) == [path]


def test_splits_and_copies_keep_the_weights(made, elsewhere):
    elsewhere()
    ibdata.split(made.path, "policy")
    elsewhere()
    copy = ibdata.split(made.path, by=None, materialize="copy")
    elsewhere()
    assert ibdata.validate(made.path) == ibdata.validate(copy.path) == []


@pytest.mark.slow
def test_workers_get_the_weights_from_the_experiment(learned, made, elsewhere):
    experiment = load(learned)
    shutil.rmtree(learned.parent)
    assert ibdata.generate(experiment, "several", workers=2).content_root == made.content_root


def test_the_identity_of_a_run_does_not_depend_on_the_path(learned):
    moved = learned.parent / "moved.safetensors"
    first = load(learned)
    (learned.parent / "actor.safetensors").rename(moved)
    second = load(learned, ["policies.0.file=moved.safetensors", "policies.1.base.file=moved.safetensors"])
    assert output_folder.identity(first) == output_folder.identity(second)
    assert isinstance(first, Experiment)
    assert [cell.digest for cell in first.cells] == [cell.digest for cell in second.cells]


def test_a_policy_is_evaluated_from_its_file(learned, capsys):
    block = learned.parent / "policy.yaml"
    block.write_text("{kind: network, file: actor.safetensors}")
    here = ibdata.evaluate(str(block), episodes=2, steps=5).returns
    given = {"kind": "network", "file": "given/actor.safetensors"}
    assert (ibdata.evaluate(given, episodes=2, steps=5).returns == here).all()
