"""polars, duckdb, Hugging Face datasets, Ray Data and PyTorch read the same bits from a dataset."""

import json
import os
import shutil

import numpy as np
import pytest
from helpers import ROOT
from helpers.folders import litter
from helpers.splits import HALVES

import ibdata

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:ray")
PROBED = ["obs_fatigue", "act_shift", "reward", "latent_mu_v"]


@pytest.fixture(scope="session", autouse=True)
def offline(tmp_path_factory):
    """No network, and no cache of the user's."""
    cache = str(tmp_path_factory.mktemp("cache"))
    os.environ.update(
        HF_HUB_OFFLINE="1", HF_HOME=cache, HF_DATASETS_CACHE=cache, HF_HUB_DISABLE_TELEMETRY="1"
    )


@pytest.fixture(scope="session")
def started():
    import ray

    ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    yield
    ray.shutdown()


def by_huggingface(root):
    from datasets import load_dataset

    return load_dataset(str(root), split="all").with_format("numpy")[:]


def by_polars(root):
    import polars as pl

    return pl.scan_parquet(f"{root}/data/part-*.parquet").collect()


def by_duckdb(root):
    import duckdb

    with duckdb.connect() as connection:
        return connection.sql(
            f"select * from '{root}/data/part-*.parquet' order by episode, step"
        ).fetchnumpy()


def by_ray_data(root):
    import ray.data

    return ray.data.read_parquet(f"{root}/data").sort(["episode", "step"]).to_pandas()


@pytest.mark.parametrize("reader", [by_huggingface, by_polars, by_duckdb, by_ray_data])
def test_values_are_those_of_ibdata(generated, started, reader):
    rows, table = reader(generated / "data/random"), ibdata.open(generated / "data/random").table()
    for column in PROBED:
        found, expected = np.asarray(rows[column]), table[column].to_numpy()
        assert found.dtype == expected.dtype
        assert found.tobytes() == expected.tobytes()


def test_splits_are_those_of_hugging_face(generated):
    from datasets import load_dataset

    root = str(generated / "data" / "transfer")
    dataset, found, streams = ibdata.open(root), load_dataset(root), load_dataset(root, streaming=True)
    assert list(found) == list(streams) == ["source", "target", "test"]
    for split in found:
        expected = dataset.table(["reward"], split)["reward"].to_numpy()
        assert found[split].with_format("numpy")["reward"][:].tobytes() == expected.tobytes()
        assert [row["reward"] for row in streams[split]] == expected.tolist()


def test_other_splits_are_configurations_of_hugging_face(tmp_path):
    """None that mixes them is called train, which would have rows to test on in it."""
    from datasets import get_dataset_config_names, load_dataset

    splits = {"train": {"setpoint": 20}, "test-1": {"setpoint": 70, "episodes": "last 50%"}}
    experiment = {"name": "x", "setpoints": [20, 70], "policies": ["random"], "episodes": 4, "steps": 5}
    root = str(ibdata.generate({**experiment, "splits": splits}, tmp_path / "x", workers=1).path)
    assert get_dataset_config_names(root) == ["default", "train", "test-1"]
    found = [load_dataset(root, name) for name in (None, "train", "test-1")]
    sizes = [{"everything": 40}, {"train": 20}, {"test_1": 10}]
    assert [{name: len(rows) for name, rows in each.items()} for each in found] == sizes
    assert set(found[1]["train"]["obs_setpoint"]) == {20}


PLAIN = {"name": "p", "setpoints": [20, 70], "policies": ["random"], "episodes": 2, "steps": 5}
OTHERS = {
    "first": ("a/p", {}),
    "overwritten": ("a/p", {"seed": 1}),
    "another order": ("a/p", {"seed": 1, "setpoints": [70, 20]}),
    "another folder of this name": ("b/p", {"seed": 2}),
    "other length": ("b/p", {"steps": 4}),
    "the first one again": ("a/p", {}),
}


@pytest.mark.parametrize(
    ("splits", "split"),
    [
        ({}, "train"),
        ({"few": {"episodes": 1}}, "everything"),
        ({"fit": {"episodes": 1}, "rest": {"episodes": "last 50%"}}, "fit"),
    ],
    ids=["none", "partial", "whole"],
)
def test_hugging_face_reads_this_dataset_and_no_other_of_its_name(tmp_path, splits, split):
    """Its cache, which the session shares, knows the name of the folder and the text of the card."""
    from datasets import load_dataset

    for case, (place, changes) in OTHERS.items():
        changed = {**PLAIN, "splits": splits, **changes}
        made = ibdata.generate(changed, tmp_path / place, workers=1, overwrite=True)
        expected = made.arrays(split=split if split in splits else None)["rewards"]
        for streaming in (False, True):
            rows = load_dataset(str(made.path), split=split, streaming=streaming)
            assert np.float32([row["reward"] for row in rows]).tolist() == expected.tolist(), case


def test_after_a_later_split_no_rows_of_hugging_face_are_called_train(tmp_path):
    from datasets import load_dataset

    made = ibdata.generate(PLAIN, tmp_path / "p", workers=1)
    assert len(load_dataset(str(made.path), split="train")) == 20
    ibdata.split(made, HALVES)
    with pytest.raises(ValueError, match=r"Unknown split \"train\". Should be one of \['everything'\]"):
        load_dataset(str(made.path), split="train")
    copy = ibdata.split(made, materialize=tmp_path / "copy")
    found = load_dataset(str(copy.path), split="train")
    assert found["reward"][:] == made.table(["reward"], "train")["reward"].to_pylist()


def test_rows_of_hugging_face_are_known_by_their_episode_and_step(tmp_path):
    """`all` is split after split, so a row has another number there."""
    from datasets import load_dataset

    splits = {"fit": {"episodes": 1}, "rest": {"episodes": "last 50%"}}
    made = ibdata.generate({**PLAIN, "splits": splits}, tmp_path / "p", workers=1)
    rows = load_dataset(str(made.path), split="all").with_format("numpy")[:]
    assert rows["episode"].tolist() != made.arrays()["episode"].tolist()
    state = ibdata.state_at(made, (rows["episode"], rows["step"]))
    assert np.float32(state.fatigue).tolist() == rows["obs_fatigue"].tolist()


def test_a_folder_from_the_hub_is_whole(generated, tmp_path):
    """The hub adds .gitattributes, the download .cache, and macOS its own files."""
    root = shutil.copytree(generated / "data/transfer", tmp_path / "transfer")
    (root / ".gitattributes").write_text("*.parquet filter=lfs diff=lfs merge=lfs -text")
    (root / ".cache/huggingface").mkdir(parents=True)
    (root / ".cache/huggingface/README.md.metadata").write_text("")
    litter(root)
    assert ibdata.validate(root) == []
    assert ibdata.open(root).content_root == ibdata.open(generated / "data/transfer").content_root
    assert len(by_huggingface(root)["reward"]) == 2000
    assert len(by_polars(root)) == len(by_duckdb(root)["reward"]) == 2000


@pytest.mark.parametrize(
    ("heading", "rows"),
    [
        ("pandas", 1000),
        ("polars", 100),
        ("duckdb", 10),
        ("PyTorch", 1000),
        ("Ray Data", 1000),
        pytest.param("Croissant", 2000, marks=pytest.mark.filterwarnings("ignore::DeprecationWarning")),
        ("D4RL's format, and NumPy", None),
        ("NeoRL", None),
    ],
)
def test_the_snippets_of_a_section_run(use_with, started, heading, rows):
    data = use_with(heading)[0]["data"]
    assert rows in (None, data.count() if heading == "Ray Data" else len(data))


def test_the_loader_of_windows(use_with):
    _, names = use_with("PyTorch")
    assert tuple(names["batch"]["observations"].shape) == (256, 180)


def test_hugging_face_draws_rows_and_no_episodes(generated):
    from datasets import load_dataset

    rows = load_dataset(str(generated / "data/random"), split="all").train_test_split(0.2, seed=0)
    assert set(rows["train"]["episode"]) == set(rows["test"]["episode"]) == set(range(10))


def test_the_snippet_of_hugging_face(use_with):
    names, checked, viewed = use_with("Hugging Face datasets")
    assert (len(names["everything"]), len(names["target"])) == (2000, 200)
    assert tuple(names["batch"].shape) == (32,)
    assert names["first"] == names["target"][0]["reward"]
    canonical = json.loads((ROOT / "docs/canonical.json").read_bytes())["transfer"]["content_root"]
    assert checked["published"] == canonical
    assert (checked["problems"], checked["is_same"]) == ([], False)  # the episodes of tests are shorter
    found, data = viewed["markov"].with_format("numpy"), viewed["ibdata"].open("data/random")
    expected = data.arrays(view={"observe": "markov", "reward": {"consumption": 1, "fatigue": 1}})
    frame = data.windows(view={"observe": "markov"}).frame
    assert (np.stack([found[name][:] for name in frame], axis=1) == expected["observations"]).all()
    assert (found["reward"][:] == expected["rewards"]).all()
