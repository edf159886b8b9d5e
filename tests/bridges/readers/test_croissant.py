"""mlcroissant reads a dataset's description without a complaint, and the rows through it."""

import logging

import mlcroissant
import numpy as np
import pytest

import ibdata
from ibdata.dataset import manifest

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of its own calls of rdflib and pandas
VARIANTS = {"random": [], "random-paper": ["output={latent: full, dtype: float64}"], "drifting": []}


@pytest.fixture(scope="module")
def described(generated, tmp_path_factory):
    """Datasets of one file and of several, in float32 and float64, merged, each with its description."""
    folder = tmp_path_factory.mktemp("described")
    sets = {"transfer": ibdata.open(generated / "data/transfer")}
    for name, more in VARIANTS.items():
        overrides = ["steps=9", "episodes=1", *more]
        sets[name] = ibdata.generate(name, folder / name, workers=1, overrides=overrides)
    other = ibdata.generate(
        "random", folder / "other", workers=1, seed=1, overrides=["steps=5", "licence=Mine"]
    )
    sets["merged"] = ibdata.merge([sets["random"].path, other.path], folder / "merged")
    return {name: (made, mlcroissant.Dataset(made.path / manifest.CROISSANT)) for name, made in sets.items()}


@pytest.fixture(params=["transfer", *VARIANTS, "merged"])
def one(request, described):
    return described[request.param]


def values(records, name, column):
    return np.array([record[f"{name}/{column}"] for record in records])


def test_it_is_read_without_an_error_or_a_warning(one, caplog):
    dataset, _ = one
    with caplog.at_level(logging.WARNING):
        read = mlcroissant.Dataset(dataset.path / manifest.CROISSANT)
        assert list(read.records("rows"))
    assert caplog.messages == []
    assert read.metadata.ctx.issues.report() == ""
    assert read.metadata.ctx.conforms_to.value == "http://mlcommons.org/croissant/1.1"


def test_every_row_is_read_with_its_types_and_bits(one):
    dataset, read = one
    table, records = dataset.table(), list(read.records("rows"))
    assert len(records) == len(dataset)
    for column in dataset.info["columns"]:
        found, expected = values(records, "rows", column["name"]), table[column["name"]].to_numpy()
        if column["dtype"] == "string":
            assert [text.decode() for text in found] == expected.tolist()
        else:
            assert (found.dtype, found.tobytes()) == (expected.dtype, expected.tobytes()), column


def test_the_rows_of_a_split_are_those_of_its_files(described):
    dataset, read = described["transfer"]
    told = {row["splits/name"]: row for row in read.records("splits")}
    assert {name: (row["splits/episodes"], row["splits/rows"]) for name, row in told.items()} == {
        name: (entry["episodes"], entry["rows"]) for name, entry in dataset.splits.items()
    }
    assert told["test"]["splits/url"] == "cr:TestSplit"
    for name in dataset.splits:
        found = values(read.records(f"split/{name}"), f"split/{name}", "reward")
        assert found.tobytes() == dataset.table(["reward"], name)["reward"].to_numpy().tobytes()
