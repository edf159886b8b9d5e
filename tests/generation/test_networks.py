"""Datasets of networks carry the weights, and need nothing else to be made and checked again."""

import json
import shutil
from pathlib import Path

import pytest
from helpers import networks
from helpers.splits import by_policy

import ibdata
from ibdata.dataset import manifest
from ibdata.errors import DatasetError, UsageError

NETWORK = {"kind": "network", "file": "actor.safetensors"}
LEARNED = {"name": "learned", "setpoints": [20, 70], "steps": 12, "output": {"shard_rows": 12}}
LEARNED["policies"] = [NETWORK, {"kind": "gaussian", "base": NETWORK, "scale": 0.2}]


@pytest.fixture
def learned(tmp_path):
    """An experiment whose weights are beside its YAML file, in another folder than the current one."""
    (tmp_path / "given").mkdir()
    (tmp_path / "given" / "actor.safetensors").write_bytes(networks.weights())
    (tmp_path / "given" / "learned.yaml").write_text(json.dumps(LEARNED))
    return tmp_path / "given" / "learned.yaml"


def test_a_dataset_carries_its_weights_and_needs_no_other(learned):
    """On another machine, it is validated, reproduced, repaired, split and made again."""
    made = ibdata.generate(learned, "made", workers=1)
    shutil.rmtree(learned.parent)
    (path,) = (path for path in made.stored.manifest.entries() if manifest.WEIGHTS.fullmatch(path))
    assert (made.path / path).read_bytes() == networks.weights()
    assert ibdata.validate(made.path) == ibdata.reproduce(made.path)[1] == []
    again = ibdata.generate(made.path / manifest.EXPERIMENT, "again", workers=1)
    assert again.content_root == made.content_root
    for lost in ("data/*-00001-*.parquet", "meta/statistics.json"):
        next(made.path.glob(lost)).unlink()
    assert len(ibdata.repair(made.path)) == 2
    copy = ibdata.split(made.path, by_policy("network", "gaussian"), materialize="copy")
    assert ibdata.validate(made.path) == ibdata.validate(copy.path) == []
    (copy.path / path).unlink()
    with pytest.raises(DatasetError, match=r"weights cannot be made again; .* there, then repair"):
        ibdata.repair(copy.path)


def test_a_run_goes_on_with_its_own_weights_only(learned):
    """Other weights are another experiment; the path of the file does not count."""
    ibdata.generate(learned, "made", shards="1/2", workers=1)
    file = learned.parent / "actor.safetensors"
    file.rename(learned.parent / "moved.safetensors")
    file.write_bytes(networks.weights(seed=1))
    with pytest.raises(UsageError, match=r"^made: holds an unfinished run of another .*\(policies.*2 of 4"):
        ibdata.generate(learned, "made", shards="1/2", workers=1)
    moved = ["policies.0.file=moved.safetensors", "policies.1.base.file=moved.safetensors"]
    kept = {path.name for path in Path(".made.part/run/dataset/data").iterdir()}
    made = ibdata.generate(learned, "made", workers=1, overrides=moved)
    assert len(kept & {path.name for path in (made.path / "data").iterdir()}) == 2
    assert ibdata.validate(made.path) == []
