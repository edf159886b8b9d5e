"""Generating: arguments, output folders, errors, and output."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
from helpers.tiny import FOUR_SHARDS

import ibdata
from ibdata import Experiment, IbdataError
from ibdata.errors import ConfigError, UsageError
from ibdata.policies.constant import Constant


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


TOKEN = re.compile("-[0-9a-f]{8}(?=[.]parquet$)")


@pytest.fixture
def tiny():
    return FOUR_SHARDS


def contents(folder):
    """Every file and folder below a folder, with the bytes of the files."""
    paths = sorted(Path(folder).rglob("*"))
    return {str(path): None if path.is_dir() else path.read_bytes() for path in paths}


def shard_hashes(dataset):
    return {file["path"]: file["sha256"] for file in dataset.manifest["files"] if "data/" in file["path"]}


# --- what it takes


def test_an_experiment_a_file_and_a_mapping_in_it_make_one_dataset(tiny):
    Path("tiny.yaml").write_text(json.dumps(FOUR_SHARDS.plain()))
    roots = {
        ibdata.generate(config, f"out/{i}", workers=1).content_root
        for i, config in enumerate([tiny, "tiny.yaml", Path("tiny.yaml").resolve()])
    }
    assert len(roots) == 1


@pytest.mark.parametrize("name", ["random", "random.yaml"])
def test_a_shipped_name_is_enough(name):
    made = ibdata.generate(name, overrides=["steps=2", "policies.0.name=mine"], workers=1)
    assert made.path == Path("data/random")
    assert len(made) == 20
    assert made.episodes["policy"].unique().tolist() == ["mine"]


def test_the_folder_defaults_to_the_name_under_data(tiny, tmp_path):
    made = ibdata.generate(tiny, workers=1)
    assert made.path == Path("data/tiny")
    assert len(ibdata.open(tmp_path / "data/tiny")) == 20


def test_folders_on_the_way_are_made(tiny):
    assert len(ibdata.generate(tiny, "a/b/c", workers=1)) == 20


def test_an_existing_empty_folder_is_used(tiny):
    Path("empty").mkdir()
    assert len(ibdata.generate(tiny, "empty", workers=1)) == 20


def test_a_seed_replaces_that_of_the_experiment(tiny):
    other = Experiment.model_validate({**FOUR_SHARDS.plain(), "seed": 9})
    made = [ibdata.generate(tiny, "a", seed=9, workers=1), ibdata.generate(other, "b", workers=1)]
    assert made[0].content_root == made[1].content_root
    assert made[0].content_root != ibdata.generate(tiny, "c", workers=1).content_root
    assert ibdata.load("a/meta/experiment.yaml") == other


class Mine(Constant):
    """A class derived from a policy of ibdata, which YAML cannot name."""

    def act(self, history, u):
        return np.full((len(history), 3), 0.9)


def test_what_is_made_is_what_the_experiments_own_yaml_gives(tiny):
    changed = tiny.model_copy(deep=True)
    assert len(changed.cells) == 2
    changed.setpoints.append(30.0)
    made = ibdata.generate(changed, "changed", workers=1)
    assert made.episodes["setpoint"].unique().tolist() == [20.0, 70.0, 30.0]
    assert ibdata.validate("changed") == []
    derived = Experiment(name="mine", setpoints=70, policies=[Mine()], steps=5)
    calls = [
        lambda: ibdata.generate(derived, "out", workers=1),
        lambda: ibdata.generate_shards(derived, "1/1", "out", workers=1),
        lambda: ibdata.estimate(derived, "out"),
    ]
    for call in calls:
        with pytest.raises(UsageError, match=r"^mine: found an experiment that its YAML does not give again"):
            call()
    changed.setpoints.append(300.0)
    with pytest.raises(ConfigError, match=r"^setpoints\.3: found 300\.0, expected"):
        ibdata.generate(changed, "out", workers=1)
    assert not Path("out").exists()


def test_a_dataset_is_made_again_from_its_own_experiment(tiny):
    first = ibdata.generate(tiny, "first", workers=1)
    again = ibdata.generate("first/meta/experiment.yaml", "again", workers=1)
    assert again.content_root == first.content_root
    hashes = [[(TOKEN.sub("", f["path"]), f["sha256"]) for f in d.manifest["files"]] for d in (first, again)]
    assert hashes[0] == hashes[1]


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (
            lambda e: ibdata.generate("no-such.yaml"),
            "config: found 'no-such.yaml', expected a file or one of",
        ),
        (lambda e: ibdata.generate(e, overrides=["steps"]), "overrides: found 'steps', expected key=value"),
        (lambda e: ibdata.generate(e, overrides={"steps": 0}), "overrides: steps: found 0, expected"),
        (lambda e: ibdata.generate(e, workers=0), "workers: found 0, expected a whole number in [1, 1024]"),
        (lambda e: ibdata.generate(e, workers=-1), "workers: found -1, expected a whole number"),
        (lambda e: ibdata.generate(e, workers=10**6), "workers: found 1000000, expected a whole number"),
        (lambda e: ibdata.generate("random", seed=-1), "seed: found -1"),
        (lambda e: ibdata.generate(e, seed=-1), "seed: found -1"),
    ],
    ids=["config", "overrides", "a mapping", "no workers", "fewer", "a million", "seed of a file", "seed"],
)
def test_a_call_that_cannot_be_meant_is_refused_before_anything_is_made(tiny, call, line):
    with pytest.raises(UsageError) as error:
        call(tiny)
    assert str(error.value).startswith(line)
    assert contents(".") == {}


# --- where it writes


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("found", ["file", "foreign", "foreign manifest", "dangling link"])
def test_what_is_not_a_dataset_is_refused_and_left_alone(tiny, found, overwrite):
    target = Path("target")
    if found == "file":
        target.write_text("mine")
    elif found == "dangling link":
        target.symlink_to("nowhere")
    else:
        (target / "meta").mkdir(parents=True)
        (target / "README.md").write_text("mine")
        if found == "foreign manifest":
            (target / "meta/manifest.json").write_text('{"files": [{"path": "README.md"}]}')
    before = contents(".") if found != "dangling link" else None
    with pytest.raises(UsageError, match=r"^target: ") as error:
        ibdata.generate(tiny, target, overwrite=overwrite, workers=1)
    assert "\n" not in str(error.value)
    assert error.value.exit_code == 2
    assert (before is None and os.readlink(target) == "nowhere") or contents(".") == before


def test_an_existing_dataset_is_replaced_only_when_asked_for(tiny):
    ibdata.generate(tiny, "target", workers=1)
    before = contents(".")
    with pytest.raises(UsageError, match=r"^target: exists already; choose another out=…, or overwrite=True"):
        ibdata.generate(tiny, "target", workers=1)
    assert contents(".") == before


def test_overwriting_removes_the_files_of_the_dataset_and_no_others(tiny):
    ibdata.generate(tiny, "target", workers=1)
    own = {"target/notes.txt": b"a", "target/meta/mine.csv": b"b", "target/figures/one.png": b"c"}
    for path, data in own.items():
        Path(path).parent.mkdir(exist_ok=True)
        Path(path).write_bytes(data)
    smaller = Experiment.model_validate({**FOUR_SHARDS.plain(), "episodes": 1, "seed": 3})
    made = ibdata.generate(smaller, "target", overwrite=True, workers=1)
    after = contents("target")
    assert {path: after.get(path) for path in own} == own
    alone = ibdata.generate(smaller, "alone", workers=1)
    files, others = (
        {TOKEN.sub("", path) for path, data in found.items() if data is not None}
        for found in (after, contents("alone"))
    )
    left = {"target/.next/data/replaced"}  # for who had opened the folder before
    assert files - set(own) - left == {path.replace("alone", "target") for path in others}
    assert len([path for path in after if path.startswith("target/data/")]) == len(made.manifest["shards"])
    assert made.content_root == alone.content_root


def test_a_file_that_is_not_the_datasets_among_its_data_is_never_overwritten(tiny):
    ibdata.generate(tiny, "target", workers=1)
    Path("target/data/part-00009.parquet").write_bytes(b"mine")
    before = contents(".")
    with pytest.raises(UsageError, match=r"part-00009\.parquet: found a file that is not the dataset's"):
        ibdata.generate(tiny, "target", overwrite=True, workers=1)
    assert contents(".") == before


def test_overwriting_a_damaged_dataset_is_refused_and_changes_nothing(tiny):
    ibdata.generate(tiny, "target", workers=1)
    manifest = Path("target/meta/manifest.json")
    manifest.write_text(manifest.read_text().replace("data/part-00000", "data/part-00009"))
    before = contents(".")
    with pytest.raises(UsageError, match="not a dataset of ibdata, left as it is"):
        ibdata.generate(tiny, "target", overwrite=True, workers=1)
    assert contents(".") == before


@pytest.mark.parametrize("out", ["file/target", "file/a/b", "x" * 300, "a/" + "x" * 300, "/proc/none/x"])
def test_a_folder_that_the_system_refuses_is_an_error_of_one_line(tiny, out):
    Path("file").write_text("mine")
    with pytest.raises(IbdataError) as error:
        ibdata.generate(tiny, out, workers=1)
    assert str(error.value).startswith(f"{out}: ")
    assert "\n" not in str(error.value)
    assert contents(".") == {"file": b"mine"}


# --- what it says


def test_progress_goes_to_stderr_only(tiny, capfd):
    ibdata.generate(tiny, "loud", workers=1, progress=True)
    loud = capfd.readouterr()
    assert loud.out == ""
    assert "20" in loud.err
    assert "transitions" in loud.err


@pytest.mark.parametrize("progress", [False, None])
def test_without_a_terminal_nothing_is_said(tiny, capfd, progress):
    ibdata.generate(tiny, "quiet", workers=1, progress=progress)
    assert capfd.readouterr() == ("", "")


def spoilt(monkeypatch, spoil):
    """Let something happen to the folder between the last shard and the manifest."""
    from ibdata.generation import generate as module

    make = module.make

    def making(spec, shards, root, *rest):
        made = make(spec, shards, root, *rest)
        spoil(root)
        return made

    monkeypatch.setattr(module, "make", making)


def test_what_another_writer_left_of_a_shard_is_no_part_of_the_dataset(tiny, monkeypatch):
    def leave(root):
        (one, *_) = sorted((root / "data").iterdir())
        (root / "data" / f"{one.name.rpartition('-')[0]}-01234567.parquet").write_bytes(one.read_bytes())

    spoilt(monkeypatch, leave)
    made = ibdata.generate(tiny, "out", workers=1)
    assert ibdata.validate("out") == []
    assert len(list((made.path / "data").iterdir())) == 4


def test_a_file_that_readers_would_take_with_the_dataset_is_named_before_it_is_finished(tiny, monkeypatch):
    spoilt(monkeypatch, lambda root: (root / "data" / "mine.parquet").write_bytes(b"mine"))
    with pytest.raises(
        UsageError, match=r"data/mine\.parquet: found something that is not the dataset's; move"
    ):
        ibdata.generate(tiny, "out", workers=1)
    assert Path("out/data/mine.parquet").read_bytes() == b"mine"
    assert not Path("out/meta/manifest.json").exists()


def test_a_run_whose_lock_was_removed_does_not_finish(tiny, monkeypatch):
    spoilt(monkeypatch, lambda root: (root / ".lock").unlink())
    with pytest.raises(IbdataError, match="its lock was removed, and another run may be writing; run again"):
        ibdata.generate(tiny, "out", workers=1)
    monkeypatch.undo()
    assert not Path("out/meta/manifest.json").exists()
