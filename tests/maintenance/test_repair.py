"""Repairing datasets."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from helpers.tiny import PLAIN

import ibdata
from ibdata import Experiment
from ibdata.dataset import manifest
from ibdata.errors import DatasetError, UsageError
from ibdata.maintenance.repair import repair
from ibdata.validation.validate import validate
from ibdata.writing.metadata import as_json

FILES = [
    "shard 0",
    "shard 3",
    "meta/dataset.json",
    "meta/episodes.parquet",
    "meta/statistics.json",
    "meta/experiment.yaml",
    "README.md",
]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def damage(path: Path, how: str) -> None:
    if how == "missing":
        path.unlink()
        return
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data[: len(data) // 2] if how == "cut" else data)


@pytest.mark.parametrize("what", [*FILES, manifest.PATH])
@pytest.mark.parametrize("how", ["missing", "cut", "flipped"])
def test_any_one_file_is_made_again_as_it_was(copied, file, what, how):
    before, path = contents(copied), file(what)
    damage(copied / path, how)
    assert repair(copied, workers=1) == [path]
    assert contents(copied) == before
    assert validate(copied) == []


def test_several_files_are_made_again_at_once(copied, file):
    before, paths = contents(copied), [file(what) for what in FILES]
    for path in paths:
        damage(copied / path, "missing")
    assert sorted(repair(copied, workers=1)) == sorted(paths)
    assert contents(copied) == before


def test_manifest_and_a_shard_are_made_again_from_the_experiment(copied, file):
    before, shard = contents(copied), file("shard 1")
    damage(copied / manifest.PATH, "flipped")
    damage(copied / shard, "cut")
    found, made = repair(copied, workers=1)
    assert found == manifest.PATH
    assert re.fullmatch(r"data/part-00001-[0-9a-f]{8}\.parquet", made)
    assert (copied / made).read_bytes() == before[shard]
    assert contents(copied).keys() ^ before.keys() == {made, shard}
    assert validate(copied) == []


def test_a_whole_dataset_is_left_alone(copied):
    before = {path: path.stat().st_mtime_ns for path in copied.rglob("*") if path.is_file()}
    assert repair(copied, workers=1) == []
    assert {path: path.stat().st_mtime_ns for path in copied.rglob("*") if path.is_file()} == before


def test_what_is_made_again_with_other_content_changes_nothing(copied, file):
    """The manifest is of another seed than its experiment says."""
    listed = json.loads((copied / manifest.PATH).read_bytes())
    listed["experiments"][0]["seed"] = 1
    listed["checksum"] = manifest.checksum(listed)
    (copied / manifest.PATH).write_bytes(as_json(listed))
    damage(copied / file("shard 0"), "cut")
    before = contents(copied)
    with pytest.raises(DatasetError, match="found other content when made again"):
        repair(copied, workers=1)
    assert contents(copied) == before


def test_a_manifest_is_not_made_again_for_shards_of_another_experiment(copied):
    path = copied / "meta/experiment.yaml"
    path.write_text(path.read_text().replace("seed: 0", "seed: 1"))
    (copied / manifest.PATH).unlink()
    before = contents(copied)
    with pytest.raises(
        DatasetError, match=r"found 0 of 8 readable shards with the content .* lists other content"
    ):
        repair(copied, workers=1)
    assert contents(copied) == before


OTHERS = {
    "more episodes": ("episodes: 3", "episodes: 4"),
    "fewer episodes": ("episodes: 3", "episodes: 2"),
    "longer episodes": ("steps: 20", "steps: 40"),
    "fewer columns": ("latent: true", "latent: false"),
    "another setpoint last": ("- 70.0", "- 71.0"),
}


def experiment_of(folder: Path, old: str, new: str) -> None:
    path = folder / "meta/experiment.yaml"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


@pytest.mark.parametrize("other", OTHERS.values(), ids=OTHERS)
@pytest.mark.parametrize("lost", ["nothing", "metadata", "other shards"])
def test_a_manifest_is_not_made_again_where_some_shards_fit_another_experiment_too(copied, other, lost):
    experiment_of(copied, *other)
    (copied / manifest.PATH).unlink()
    if lost == "metadata":
        (copied / "README.md").unlink()
        (copied / "meta/episodes.parquet").write_bytes(b"x")
    if lost == "other shards":
        for number in range(1, 8):
            damage(next((copied / "data").glob(f"part-0000{number}-*")), "cut")
    before = contents(copied)
    with pytest.raises(DatasetError, match=r"readable shards with the content .*; nothing was changed"):
        repair(copied, workers=1)
    assert contents(copied) == before


@pytest.mark.parametrize("proof", ["README.md", "meta/episodes.parquet"])
def test_card_or_table_of_episodes_prove_an_experiment_whose_shards_are_all_damaged(copied, made, proof):
    for path in {"README.md", "meta/episodes.parquet"} - {proof}:
        (copied / path).unlink()
    for path in (copied / "data").iterdir():
        damage(path, "cut")
    (copied / manifest.PATH).unlink()
    assert len(repair(copied, workers=1)) == 9
    assert ibdata.open(copied).content_root == made.content_root
    assert validate(copied) == []


def test_shards_that_are_all_damaged_prove_nothing_alone(copied):
    for path in [*(copied / "data").iterdir(), copied / manifest.PATH, copied / "README.md"]:
        path.unlink()
    (copied / "meta/episodes.parquet").write_bytes(b"x")
    before = contents(copied)
    message = r"0 of 0 readable .*README\.md lists no content that can be read, meta/episodes.* no content"
    with pytest.raises(DatasetError, match=message):
        repair(copied, workers=1)
    assert contents(copied) == before


def test_whole_shards_prove_an_experiment_whatever_an_edited_card_says(copied, made):
    (copied / manifest.PATH).unlink()
    card = copied / "README.md"
    card.write_text(card.read_text().replace(made.content_root, "0" * 64))
    assert repair(copied, workers=1) == [manifest.PATH]
    assert ibdata.open(copied).content_root == made.content_root
    assert validate(copied) == []


def test_a_readable_shard_is_not_made_again_even_if_the_card_proves_that_its_rows_are_others(copied, file):
    (copied / manifest.PATH).unlink()
    shutil.copy(copied / file("shard 0"), copied / file("shard 1"))
    before = contents(copied)
    with pytest.raises(DatasetError, match=r"7 of 8 readable .*, and part-00001-\w{8}\.parquet has other"):
        repair(copied, workers=1)
    assert contents(copied) == before


@pytest.mark.parametrize("name", ["part-00009.parquet", ".part-00000-aaaaaaaa.parquet", ".h"])
def test_what_is_not_ibdatas_in_data_is_named_before_a_manifest_is_made_again(copied, name):
    (copied / manifest.PATH).unlink()
    (copied / "data" / name).mkdir()
    before = contents(copied)
    with pytest.raises(UsageError, match="found something that ibdata did not write; move it away"):
        repair(copied, workers=1)
    assert contents(copied) == before


def test_there_is_nothing_to_repair_where_no_dataset_is(tmp_path):
    with pytest.raises(DatasetError, match="no dataset here: meta is missing"):
        repair(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_resuming_a_finished_dataset_that_is_damaged_is_an_error(copied, file):
    shard = file("shard 1")
    (copied / shard).unlink()
    with pytest.raises(DatasetError, match=f"{re.escape(shard)}: damaged or missing; run ibdata repair"):
        ibdata.generate(Experiment.model_validate(PLAIN), copied, workers=1, resume=True)


def test_metadata_are_made_again_from_the_rows_and_never_from_a_simulation(copied, monkeypatch):
    """As on a machine with other bits, or with a custom policy that was changed since."""

    def simulate(*_, **__):
        raise AssertionError("simulated")

    before = contents(copied)
    for module in ("ibdata.simulation.rollout", "ibdata.writing.summary", "ibdata.generation.warm_up"):
        monkeypatch.setattr(f"{module}.rollout", simulate)
    for path in ("meta/episodes.parquet", "meta/statistics.json"):
        damage(copied / path, "cut")
        assert repair(copied, workers=1) == [path]
        assert contents(copied) == before


def test_metadata_are_not_made_again_from_rows_that_are_not_those_listed(copied, shard_file):
    table = pq.read_table(copied / shard_file(copied, 1))
    name = "latent_mu_v"
    changed = table.set_column(table.column_names.index(name), table.schema.field(name), table["latent_mu_g"])
    pq.write_table(changed, copied / shard_file(copied, 1))
    listed = json.loads((copied / manifest.PATH).read_bytes())
    data = (copied / shard_file(copied, 1)).read_bytes()
    for file in listed["files"]:
        if file["path"] == shard_file(copied, 1):
            file |= {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
    listed["checksum"] = manifest.checksum(listed)
    (copied / manifest.PATH).write_bytes(as_json(listed))
    (copied / "meta/episodes.parquet").write_bytes(b"x")
    before = contents(copied)
    with pytest.raises(
        DatasetError, match=r"found other content .*expected the content that the manifest lists; nothing"
    ):
        repair(copied, workers=1)
    assert contents(copied) == before


def test_a_dataset_without_manifest_and_experiment_is_lost(copied):
    for path in (manifest.PATH, manifest.EXPERIMENT):
        (copied / path).unlink()
    with pytest.raises(DatasetError, match=r"manifest\.json and meta/experiment\.yaml are lost, so nothing"):
        repair(copied, workers=1)


def test_a_forged_plan_is_named_although_every_file_is_as_listed(copied):
    listed = json.loads((copied / manifest.PATH).read_bytes())
    listed["experiments"][0]["steps"] += 1
    listed["checksum"] = manifest.checksum(listed)
    (copied / manifest.PATH).write_bytes(as_json(listed))
    with pytest.raises(DatasetError, match=r"experiments: .* see ibdata validate"):
        repair(copied, workers=1)
