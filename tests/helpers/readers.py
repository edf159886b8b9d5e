"""What the readers that people use find in a dataset: its rewards, in order."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

Rewards = list[float]


def by_pyarrow(folder: Path) -> Callable[[], Rewards]:
    """Through a list of files that is made first and opened later."""
    import pyarrow.dataset

    listed = pyarrow.dataset.dataset(folder / "data")
    return lambda: listed.to_table(["reward"])["reward"].to_pylist()  # type: ignore[no-any-return]


def by_pandas(folder: Path) -> Callable[[], Rewards]:
    """The folder."""
    import pandas as pd

    return lambda: pd.read_parquet(folder / "data", columns=["reward"])["reward"].tolist()


def by_polars(folder: Path) -> Callable[[], Rewards]:
    """The folder, whose files are listed when the frame is collected."""
    import polars as pl

    frame = pl.scan_parquet(folder / "data")
    return lambda: frame.select("reward").collect()["reward"].to_list()


def by_duckdb(folder: Path) -> Callable[[], Rewards]:
    """A pattern."""
    import duckdb

    connection = duckdb.connect()
    rows = connection.sql(f"select reward from '{folder}/data/*.parquet'")
    # older versions close a connection that nobody holds
    return lambda connection=connection: [reward for (reward,) in rows.fetchall()]


def by_ibdata(folder: Path | str) -> Callable[[], Rewards]:
    """The files that the manifest lists, in batches of which the first is read at once."""
    import ibdata

    batches = ibdata.open(folder).iter_batches(["reward"], batch_rows=5)
    first = next(batches)
    return lambda: [reward for batch in (first, *batches) for reward in batch["reward"].to_pylist()]


READERS: dict[str, Callable[[Any], Callable[[], Rewards]]] = {
    "pyarrow": by_pyarrow,
    "pandas": by_pandas,
    "polars": by_polars,
    "duckdb": by_duckdb,
    "ibdata": by_ibdata,
}


def found(read: Callable[[], Any]) -> Any:
    """What a reader gives; None for an error, and each reader has errors of its own."""
    try:
        return read()
    except Exception:
        return None
    except BaseException as error:  # polars opens a file twice, and it may have shrunk
        if type(error).__name__ != "PanicException":
            raise
        return None


def opened(folder: Path, url: str | None = None) -> dict[str, Callable[[], Rewards | None]]:
    """Readers that have opened a dataset, or met an error, and that read when they are called.

    If there is a URL of the folder, ibdata reads that.
    """
    begun = {}
    for name, begin in READERS.items():
        place = url or folder if name == "ibdata" else folder
        begun[name] = found(lambda begin=begin, place=place: begin(place))
    return {name: lambda read=read: None if read is None else found(read) for name, read in begun.items()}


def rewards(folder: Path) -> dict[str, Rewards | None]:
    """The rewards that each reader finds in a dataset, whatever its order; None where it meets an error."""
    read = {name: reader() for name, reader in opened(folder).items()}
    return {name: None if values is None else sorted(values) for name, values in read.items()}
