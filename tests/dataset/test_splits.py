"""Splits that were made later: how they are read, and what a damaged meta/splits.json gives."""

import json

import numpy as np
import pytest

import ibdata
from ibdata.errors import BusyError, DatasetError

LATER = {
    "odd": {"episodes": 3, "rows": 120, "split": {"episodes": 1}, "runs": [[1, 2], [4, 6]]},
    "first": {"episodes": 1, "rows": 40, "split": {"setpoint": 20.0}, "runs": [[0, 1]]},
}
LATER = {name: {"declared": False, **split} for name, split in LATER.items()}


def change(folder, edit):
    path = folder / "meta/splits.json"
    listed = json.loads(path.read_text())
    edit(listed)
    path.write_text(json.dumps(listed))


@pytest.fixture
def split(copied):
    """`dataset` with later splits."""
    change(copied, lambda listed: listed.update(LATER))
    return ibdata.open(copied)


def test_later_splits_follow_the_declared_ones(split, dataset):
    assert list(split.splits) == ["source", "target", "odd", "first"]
    assert split.splits["odd"] == {"episodes": 3, "rows": 120, "declared": False}
    assert split.splits["source"]["declared"]
    expected = [
        [*names, *(name for name in LATER if any(a <= e < b for a, b in LATER[name]["runs"]))]
        for e, names in enumerate(dataset.episodes["splits"])
    ]
    assert [list(names) for names in split.episodes["splits"]] == expected


@pytest.mark.parametrize("most", [10**6, 20], ids=["all rows", "a sample"])
def test_the_statistics_of_a_later_split_are_those_of_its_rows(split, small_blocks, most):
    small_blocks(sampled_rows=most)
    found, rows = split.statistics("odd"), split.to_pandas(split="odd")
    assert list(found) == list(split.statistics())
    for name, described in found.items():
        x = rows[name].to_numpy().astype(np.float64)
        assert (described["count"], described["min"], described["max"]) == (120, x.min(), x.max())
        assert described["mean"] == pytest.approx(x.mean(), rel=1e-12, abs=1e-12)
        assert described["std"] == pytest.approx(x.std(), rel=1e-9, abs=1e-12)
        quantiles = np.quantile(x, [float(q) for q in described["quantiles"]], method="inverted_cdf")
        if most > len(x):
            assert list(described["quantiles"].values()) == quantiles.tolist()


def test_a_damaged_file_of_splits_is_an_error_with_its_remedy(copied):
    path = copied / "meta/splits.json"
    for damage in (lambda: path.write_text("{"), path.unlink):
        damage()
        dataset = ibdata.open(copied)
        assert len(dataset.table()) == 480
        for read in (lambda: dataset.splits, lambda: dataset.table(split="source"), lambda: dataset.episodes):  # noqa: B023
            with pytest.raises(DatasetError) as error:
                read()
            assert str(error.value).startswith(f"{copied}/meta/splits.json: ")
            assert str(error.value).endswith(f"; run ibdata repair {copied}")


READS = {
    "rows": lambda d: d.table(),
    "batches": lambda d: list(d.iter_batches()),
    "info": lambda d: d.info,
    "splits": lambda d: d.splits,
    "episodes": lambda d: d.episodes,
    "statistics": lambda d: d.statistics(),
}


def test_a_dataset_replaced_after_opening_is_refused(describe, made_at, tmp_path):
    made_at(describe(), tmp_path / "x")
    opened = {name: ibdata.open(tmp_path / "x") for name in READS}
    ibdata.generate(describe(steps=20), tmp_path / "x", workers=1, overwrite=True)
    for name, read in READS.items():
        with pytest.raises(BusyError, match=r"x: replaced while it was read; open it again$") as error:
            read(opened[name])
        assert error.value.exit_code == 75
    assert len(ibdata.open(tmp_path / "x").table()) == 240


def test_a_dataset_that_is_open_reads_splits_that_were_made_since(tmp_path):
    """Else episodes of a test split would be in the train split of before."""
    plain = {"name": "s", "setpoints": 20, "policies": ["random"], "episodes": 10, "steps": 5}
    ds = ibdata.generate(plain, tmp_path / "s", workers=1)
    for train in (8, 5, 9):
        splits = {"train": {"episodes": f"first {train}0%"}, "test": {"episodes": f"last {10 - train}0%"}}
        ibdata.split(ds if train != 9 else ds.path, splits)
        assert ds.splits["train"]["episodes"] == train
        assert sum(names.tolist() == ["train"] for names in ds.episodes["splits"]) == train
        seen = set(ds.arrays(split="train")["episode"]), set(ds.arrays(split="test")["episode"])
        assert [len(part) for part in seen] == [train, 10 - train]
        assert not set.intersection(*seen)
        assert ds.statistics("train") == ibdata.open(ds.path).statistics("train")
