"""pandas, polars and duckdb read the folder `data` directly, with equal bits."""

from __future__ import annotations

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pytest

PROBED = ["obs_fatigue", "reward", "latent_mu_v"]
KEY = ["episode", "step"]
FATIGUE = 40.0


def by_pandas(root):
    return pd.read_parquet(f"{root}/data")


def by_polars(root):
    return pl.scan_parquet(f"{root}/data/*.parquet").collect()


def by_duckdb(root, columns="*", where="true"):
    with duckdb.connect() as connection:
        return connection.sql(f"select {columns} from '{root}/data/*.parquet' where {where}").fetchnumpy()


readers = pytest.mark.parametrize("reader", [by_pandas, by_polars, by_duckdb])


def in_order(rows, name):
    """A column ordered by episode and step, whatever order a reader returns."""
    order = np.lexsort((np.asarray(rows["step"]), np.asarray(rows["episode"])))
    return np.asarray(rows[name])[order]


@readers
def test_a_reader_finds_the_rows_of_the_manifest(either, reader):
    rows = reader(either.path)
    assert len(np.asarray(rows["reward"])) == either.manifest["rows"]
    assert list(rows.keys() if isinstance(rows, dict) else rows.columns) == either.table().column_names


@readers
@pytest.mark.parametrize("name", PROBED)
def test_values_are_those_of_ibdata_bit_for_bit(either, reader, name):
    expected = either.table()[name].to_numpy()
    found = in_order(reader(either.path), name)
    assert found.dtype == expected.dtype
    assert found.tobytes() == expected.tobytes()


@readers
def test_indices_flags_and_labels_keep_their_meaning(dataset, reader):
    rows, table = reader(dataset.path), dataset.table()
    assert in_order(rows, "episode").dtype == np.int64
    assert in_order(rows, "step").dtype == np.int32
    assert in_order(rows, "truncated").dtype == np.bool_
    for name in ("truncated", "terminated", "policy"):
        assert in_order(rows, name).tolist() == table[name].to_pylist()


def test_a_filter_keeps_the_same_rows_in_every_reader(dataset):
    pandas, polars = by_pandas(dataset.path), pl.scan_parquet(f"{dataset.path}/data/*.parquet")
    kept = [
        pandas[(pandas["obs_setpoint"] == 70) & (pandas["obs_fatigue"] > FATIGUE)],
        polars.filter((pl.col("obs_setpoint") == 70) & (pl.col("obs_fatigue") > FATIGUE)).collect(),
        by_duckdb(dataset.path, where=f"obs_setpoint = 70 and obs_fatigue > {FATIGUE}"),
    ]
    rows = dataset.table().to_pylist()
    wanted = [row for row in rows if row["obs_setpoint"] == 70 and row["obs_fatigue"] > FATIGUE]
    assert 10 < len(wanted) < 200
    for found in kept:
        for name in [*KEY, *PROBED]:
            assert in_order(found, name).tolist() == [row[name] for row in wanted]


def test_a_few_columns_can_be_read_alone(dataset):
    names = [*KEY, "reward"]
    found = [
        pd.read_parquet(f"{dataset.path}/data", columns=names),
        pl.scan_parquet(f"{dataset.path}/data/*.parquet").select(names).collect(),
        by_duckdb(dataset.path, ", ".join(names)),
    ]
    expected = dataset.table()["reward"].to_numpy()
    for rows in found:
        assert len(list(rows.keys() if isinstance(rows, dict) else rows.columns)) == 3
        assert in_order(rows, "reward").tobytes() == expected.tobytes()
