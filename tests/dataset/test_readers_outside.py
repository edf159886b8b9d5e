"""pandas, polars and duckdb read the folder `data` directly, with equal bits."""

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pytest

TYPES = {
    "episode": np.int64,
    "step": np.int32,
    "obs_fatigue": None,
    "reward": None,
    "latent_mu_v": None,
    "truncated": np.bool_,
    "terminated": np.bool_,
}
FATIGUE = 40.0


def by_pandas(root):
    rows = pd.read_parquet(f"{root}/data")
    return rows, rows[(rows["obs_setpoint"] == 70) & (rows["obs_fatigue"] > FATIGUE)]


def by_polars(root):
    rows = pl.scan_parquet(f"{root}/data/*.parquet")
    kept = rows.filter((pl.col("obs_setpoint") == 70) & (pl.col("obs_fatigue") > FATIGUE))
    return rows.collect(), kept.collect()


def by_duckdb(root):
    query = f"select * from '{root}/data/*.parquet'"
    with duckdb.connect() as connection:
        rows = connection.sql(query).fetchnumpy()
        kept = connection.sql(f"{query} where obs_setpoint = 70 and obs_fatigue > {FATIGUE}").fetchnumpy()
    return rows, kept


def in_order(rows, name):
    """A column ordered by episode and step, whatever order a reader returns."""
    order = np.lexsort((np.asarray(rows["step"]), np.asarray(rows["episode"])))
    return np.asarray(rows[name])[order]


@pytest.mark.parametrize("reader", [by_pandas, by_polars, by_duckdb])
def test_a_reader_finds_the_values_of_ibdata_bit_for_bit(either, reader):
    """And a filter keeps the right rows, whatever the reader takes from the statistics of a file."""
    rows, filtered = reader(either.path)
    table = either.table()
    assert list(rows.keys() if isinstance(rows, dict) else rows.columns) == table.column_names
    kept = (table["obs_setpoint"].to_numpy() == 70) & (table["obs_fatigue"].to_numpy() > FATIGUE)
    for name, dtype in TYPES.items():
        expected = table[name].to_numpy()
        assert in_order(rows, name).dtype == expected.dtype == (dtype or expected.dtype)
        assert in_order(rows, name).tobytes() == expected.tobytes()
        assert in_order(filtered, name).tobytes() == expected[kept].tobytes()
    assert in_order(rows, "policy").tolist() == table["policy"].to_pylist()


def test_the_filter_keeps_some_rows(dataset):
    assert 10 < len(by_pandas(dataset.path)[1]) < 200
