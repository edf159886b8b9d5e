"""Experiments and datasets that several tests read, and a second, simple implementation of digests."""

from __future__ import annotations

import hashlib
import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import ibdata
from ibdata import Dataset, Experiment
from ibdata.generation.pieces import INDEXED

# Options of `pyarrow.parquet.write_table` with which a footer is as in a file of ibdata's.
AS_WRITTEN: dict[str, Any] = {"write_statistics": list(INDEXED), "use_dictionary": ["policy"]}
Made = Callable[[Any, Path], Dataset]
Digests = Callable[[pa.Table], dict[int, bytes]]
Root = Callable[[Dataset, pa.Table], str]
# The shards of these two have one episode each.
FOUR_SHARDS = Experiment.model_validate(
    {
        "name": "tiny",
        "setpoints": [20.0, 70.0],
        "policies": [{"kind": "random"}],
        "episodes": 2,
        "steps": 5,
        "output": {"shard_rows": 5},
    }
)
TEN_SHARDS = FOUR_SHARDS.model_copy(update={"episodes": 5})
PLAIN = {
    "name": "tiny",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "random"}, {"kind": "safe"}],
    "episodes": 3,
    "steps": 20,
    "output": {"shard_rows": 40},
    "splits": {"source": {"setpoint": 20}},
}
MANY = {  # for splits
    "name": "many",
    "setpoints": [10.0, 30.0, 50.0, 75.0, 90.0],
    "policies": [{"kind": "random"}, {"kind": "safe"}],
    "episodes": 5,
    "steps": 4,
    "output": {"shard_rows": 40},
    "splits": {"low": {"setpoint": [10, 30], "overlap": True}},
}


def four_shards_at(url: Path | str, **options: Any) -> Dataset:
    """The dataset of FOUR_SHARDS at a place or a URL."""
    return ibdata.generate(FOUR_SHARDS, url, workers=1, **options)


@pytest.fixture(scope="session")
def describe() -> Callable[..., Experiment]:
    """A function that makes an experiment of 12 episodes of 40 steps, with changes to its options."""

    def make(**changes: Any) -> Experiment:
        plain = {
            "name": "small",
            "setpoints": [20.0, 70.0],
            "policies": [{"kind": "random"}, {"kind": "safe", "name": "calm"}],
            "episodes": 3,
            "steps": 40,
        }
        return Experiment.model_validate({**plain, **changes})

    return make


@pytest.fixture(scope="session")
def made_at(tmp_path_factory) -> Made:
    """A function for the dataset of an experiment at a place; it is generated once, then copied."""
    known: dict[str, Path] = {}

    def at(experiment: Any, out: Path) -> Dataset:
        whole = Experiment.model_validate(experiment)
        key = json.dumps(whole.plain(), sort_keys=True)
        if key not in known:
            known[key] = tmp_path_factory.mktemp("once") / "made"
            ibdata.generate(whole, known[key], workers=1)
        return ibdata.open(shutil.copytree(known[key], out))

    return at


@pytest.fixture(scope="session")
def declared(describe) -> Experiment:
    """The experiment of `dataset`: splits, several shards, and all latent columns except derived ones."""
    return describe(
        output={"latent": "next", "shard_rows": 100},
        splits={"source": {"setpoint": 20}, "target": {"setpoint": 70, "episodes": 2}},
    )


@pytest.fixture(scope="session")
def dataset(declared, tmp_path_factory) -> Dataset:
    return ibdata.generate(declared, tmp_path_factory.mktemp("dataset") / "small", workers=1)


@pytest.fixture(scope="session")
def doubles(declared, tmp_path_factory) -> Dataset:
    """The same in float64, which most exports round."""
    output = declared.output.model_copy(update={"dtype": "float64"})
    experiment = declared.model_copy(update={"output": output})
    return ibdata.generate(experiment, tmp_path_factory.mktemp("dataset") / "small", workers=1)


@pytest.fixture(scope="session")
def tiny(tmp_path_factory) -> list[Dataset]:
    """The datasets of FOUR_SHARDS of the seeds 0 and 1."""
    folder = tmp_path_factory.mktemp("tiny")
    return [ibdata.generate(FOUR_SHARDS, folder / str(seed), seed=seed, workers=1) for seed in (0, 1)]


@pytest.fixture(scope="session")
def moving(describe, tmp_path_factory) -> Dataset:
    """A dataset with moving setpoints, derived values, float64, the other variant and a burn-in."""
    experiment = describe(
        dynamics="paper",
        setpoints={"drifting": [0.5, 99.5]},
        start={"burn_in": [0, 9]},
        seed=7,
        output={"latent": "full", "dtype": "float64"},
    )
    return ibdata.generate(experiment, tmp_path_factory.mktemp("dataset") / "moving", workers=1)


@pytest.fixture(scope="session")
def large(describe, tmp_path_factory) -> Dataset:
    """A dataset of 120,000 rows in one file: more than a row group, and more than quantiles use."""
    experiment = describe(name="large", episodes=30, steps=1000, output={"latent": False})
    return ibdata.generate(experiment, tmp_path_factory.mktemp("dataset") / "large", workers=1)


@pytest.fixture(params=["dataset", "moving"])
def either(request) -> Dataset:
    return request.getfixturevalue(request.param)


@pytest.fixture
def copied(dataset, tmp_path) -> Path:
    """A copy of the folder of `dataset` that a test may damage."""
    return Path(shutil.copytree(dataset.path, tmp_path / "copied"))


@pytest.fixture(scope="session")
def plain_digests() -> Digests:
    """A function for the digests of a table's episodes by number, written from the documentation alone."""

    def as_bytes(column: pa.ChunkedArray) -> bytes:
        if pa.types.is_dictionary(column.type):
            (value,) = set(column.to_pylist())
            return struct.pack("<Q", len(value.encode())) + value.encode()
        values = np.array(column.to_pylist(), dtype=column.type.to_pandas_dtype())
        return values.astype(values.dtype.newbyteorder("<")).tobytes()

    def digests(table: pa.Table) -> dict[int, bytes]:
        numbers = np.array(table["episode"])
        out = {}
        for episode in np.unique(numbers).tolist():
            rows = table.filter(pa.array(numbers == episode))
            hasher = hashlib.sha256(struct.pack("<Q", rows.num_rows))
            for name in rows.column_names:
                if name != "episode":
                    hasher.update(as_bytes(rows[name]))
            out[episode] = hasher.digest()
        return out

    return digests


@pytest.fixture(scope="session")
def plain_root(plain_digests) -> Root:
    """A function for the content root of a table with all rows of a dataset, written in the same way."""

    def root(dataset: Dataset, table: pa.Table) -> str:
        found = plain_digests(table)
        types = {c["name"]: c["dtype"] for c in dataset.info["columns"]}
        head = "".join(f"{name}:{types[name]}\n" for name in table.column_names if name != "episode")
        rows = dataset.episodes
        keys = zip(rows["cell"], rows["index"], rows["episode"], strict=True)
        members = sorted((bytes.fromhex(cell), index, found[episode]) for cell, index, episode in keys)
        body = b"".join(cell + struct.pack("<Q", index) + digest for cell, index, digest in members)
        return hashlib.sha256(head.encode() + body).hexdigest()

    return root
