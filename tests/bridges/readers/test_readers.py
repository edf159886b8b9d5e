"""polars, duckdb, Hugging Face datasets, Ray Data and PyTorch read the same bits from a dataset."""

import os

import numpy as np
import pytest

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

    return load_dataset(str(root), split="train").with_format("numpy")[:]


def by_polars(root):
    import polars as pl

    return pl.scan_parquet(f"{root}/data/*.parquet").collect()


def by_duckdb(root):
    import duckdb

    with duckdb.connect() as connection:
        return connection.sql(f"select * from '{root}/data/*.parquet' order by episode, step").fetchnumpy()


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


def test_splits_are_configs_of_hugging_face(generated):
    from datasets import get_dataset_config_names, load_dataset

    root = str(generated / "data" / "transfer")
    assert sorted(get_dataset_config_names(root)) == ["default", "source", "target", "test"]
    dataset = ibdata.open(root)
    for config in ("source", "target", "test"):
        found = load_dataset(root, config, split="train")
        assert len(found) == dataset.splits[config]["rows"]
        expected = dataset.table(["reward"], config)["reward"].to_numpy()
        assert found.with_format("numpy")["reward"][:].tobytes() == expected.tobytes()


@pytest.mark.parametrize(
    ("heading", "rows"),
    [
        ("pandas", 1000),
        ("polars", 100),
        ("duckdb", 10),
        ("PyTorch", 1000),
        ("Ray Data", 1000),
        ("D4RL's format, and NumPy", None),
        ("NeoRL", None),
    ],
)
def test_the_snippets_of_a_section_run(use_with, started, heading, rows):
    (names,) = use_with(heading)
    data = names["data"]
    assert rows in (None, data.count() if heading == "Ray Data" else len(data))


def test_the_snippet_of_hugging_face(use_with):
    names, viewed = use_with("Hugging Face datasets")
    assert (len(names["everything"]), len(names["target"])) == (2000, 200)
    assert tuple(names["batch"].shape) == (32,)
    found, data = viewed["markov"].with_format("numpy"), viewed["ibdata"].open("data/random")
    expected = data.arrays(view={"observe": "markov", "reward": {"consumption": 1, "fatigue": 1}})
    frame = data.windows(view={"observe": "markov"}).frame
    assert (np.stack([found[name][:] for name in frame], axis=1) == expected["observations"]).all()
    assert (found["reward"][:] == expected["rewards"]).all()
