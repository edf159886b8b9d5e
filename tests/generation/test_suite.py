"""Generating a folder of experiments: all are checked first, and each gets its own folder."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment
from ibdata.errors import ConfigError, UsageError
from ibdata.experiment import suites
from ibdata.generation.suite import preview_all
from ibdata.validation.validate import validate

PLAIN = {"setpoints": 70, "policies": [{"kind": "random"}], "steps": 5}
SMALL = ["episodes=1", "steps=20"]


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def two():
    folder = Path("two")
    folder.mkdir()
    for name in ("a", "b"):
        (folder / f"{name}.yaml").write_text(json.dumps({**PLAIN, "name": f"set-{name}"}))
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("suite", suites())
def test_every_experiment_of_a_shipped_suite_makes_a_valid_dataset(suite):
    made = ibdata.generate_all(suite, workers=1, overrides=SMALL)
    assert list(made) == [path.stem for path in sorted(suites()[suite].glob("*.yaml"))]
    for name, dataset in made.items():
        experiment = ibdata.load(f"{suite}/{name}")
        assert dataset.path == Path("data") / suite / name
        assert validate(dataset.path) == []
        assert len(dataset) == 20 * len(experiment.cells)
        assert set(dataset.to_pandas(["policy"])["policy"]) == set(experiment.labels)


def test_the_batch_of_depeweg_makes_a_valid_dataset():
    dataset = ibdata.generate("depeweg", workers=1, overrides=["steps=20"])
    assert validate(dataset.path) == []
    rows = {name: len(dataset.to_pandas(["reward"], split=name)) for name in ("train", "test")}
    assert rows == {"train": 10 * 7 * 20, "test": 10 * 3 * 20}


def test_the_siemens_sets_have_files_to_train_and_to_validate_on_and_the_rows_of_a_set_without_splits():
    small = {"steps": 5}
    dataset = ibdata.generate("siemens-offline/bad-20", workers=1, overrides=small)
    assert {name: split["episodes"] for name, split in dataset.splits.items()} == {
        "train": 90,
        "validation": 10,
    }
    assert set(dataset.to_pandas(["episode"], split="validation")["episode"]) == set(range(90, 100))
    plain = ibdata.generate("siemens-offline/bad-20", "plain", workers=1, overrides={**small, "splits": {}})
    assert plain.splits == {}
    assert plain.content_root == dataset.content_root


def test_a_dataset_of_a_suite_is_the_one_that_its_experiment_makes_alone(two):
    made = ibdata.generate_all(two, "out", workers=1, seed=3)
    alone = ibdata.generate(two / "b.yaml", "alone", workers=1, seed=3)
    assert made["set-b"].path == Path("out/set-b")
    assert made["set-b"].content_root == alone.content_root


def test_no_dataset_is_made_where_one_experiment_or_place_is_wrong(two):
    with pytest.raises(ConfigError, match="steps: found 0"):
        ibdata.generate_all(two, workers=1, overrides=["steps=0"])
    ibdata.generate(two / "b.yaml", "data/two/set-b", workers=1)
    with pytest.raises(UsageError, match="data/two/set-b: exists already"):
        ibdata.generate_all(two, workers=1)
    with pytest.raises(UsageError, match="workers"):
        ibdata.generate_all(two, "out", workers=0)
    Path("file").touch()
    with pytest.raises(UsageError, match="file: is a file, not a folder"):
        ibdata.generate_all(two, "file", workers=1)
    assert [path.name for path in Path("data/two").iterdir()] == ["set-b"]


def test_resume_passes_over_what_is_finished_and_makes_the_rest(two):
    done = ibdata.generate(two / "a.yaml", "data/two/set-a", workers=1)
    before = (done.path / "meta/manifest.json").stat().st_mtime_ns
    made = ibdata.generate_all(two, workers=1, resume=True)
    assert list(made) == ["set-a", "set-b"]
    assert (done.path / "meta/manifest.json").stat().st_mtime_ns == before


def test_resume_goes_on_with_the_one_that_was_stopped(two, monkeypatch):
    def stop(*args):
        raise KeyboardInterrupt

    many = ["output.shard_rows=5", "episodes=3"]
    with monkeypatch.context() as patched:
        patched.setattr("ibdata.generation.generate.finish", stop)
        with pytest.raises(KeyboardInterrupt):
            ibdata.generate_all(two, workers=1, overrides=many)
    assert len(list(Path("data/two/set-a/data").iterdir())) == 3
    assert not Path("data/two/set-b").exists()
    made = ibdata.generate_all(two, workers=1, overrides=many, resume=True)
    assert [validate(dataset.path) for dataset in made.values()] == [[], []]


def test_the_estimates_are_those_of_the_single_runs(two):
    guessed = preview_all(two, workers=1)
    assert [(g["name"], g["out"], g["rows"]) for g in guessed] == [
        ("set-a", "data/two/set-a", 5),
        ("set-b", "data/two/set-b", 5),
    ]
    assert not Path("data").exists()


def test_a_single_experiment_is_made_where_generate_makes_it(two):
    (made,) = ibdata.generate_all(two / "a.yaml", workers=1).values()
    assert made.path == Path("data/set-a")


def test_a_single_experiment_is_made_as_in_a_folder(two):
    made = ibdata.generate_all(two / "a.yaml", "out", workers=1)
    assert list(made) == ["set-a"]
    assert isinstance(ibdata.load(two / "a.yaml"), Experiment)
