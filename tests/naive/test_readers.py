"""What people do with the rows of a dataset in a normal year: selections, windows, exports, other readers."""

import json
import zipfile
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow.dataset
import pytest
from ruamel.yaml import YAML

import ibdata
from ibdata.errors import BusyError, UsageError

ODD = 20.1  # which float32 cannot hold
PLAIN = {
    "name": "p",
    "setpoints": [ODD, 70],
    "policies": ["random", "safe"],
    "episodes": 3,
    "steps": 20,
    "splits": {"train": {"episodes": 2}, "test": {"episodes": "last 33%"}},
}
HIDDEN = {"observe": "markov"}  # which leaves out the last row of an episode


def made(place, **changes):
    return ibdata.generate({**PLAIN, **changes}, place, workers=1, overwrite=True)


@pytest.fixture(scope="module")
def ds(tmp_path_factory):
    return made(tmp_path_factory.mktemp("naive") / "p")


def same(found, expected):
    assert found.keys() == expected.keys()
    assert all(np.array_equal(found[name], expected[name], equal_nan=True) for name in found)


# A number of the library's own tables is handed back.


def test_setpoints_of_the_table_of_episodes_are_selected(ds):
    """`for p in ds.episodes.setpoint.unique(): ds.select(setpoint=p)`: the parts are the whole."""
    parts = [ds.select(setpoint=p) for p in ds.episodes["setpoint"].unique()]
    assert [len(part) for part in parts] == [120, 120]
    assert len(ds.select(setpoint=ds.episodes["setpoint"])) == 240


def test_setpoints_of_the_table_of_episodes_are_evaluated(ds):
    """`evaluate(…, setpoint=ds.episodes.setpoint.unique())` is `evaluate(…, setpoint=[20.1, 70])`."""
    options = {"steps": 20, "episodes": 2}
    found = ibdata.evaluate("random", setpoint=ds.episodes["setpoint"].unique(), **options)
    assert found.plain() == ibdata.evaluate("random", setpoint=[ODD, 70], **options).plain()
    one = ibdata.evaluate("random", setpoint=ds.episodes["setpoint"][0], **options)
    assert one.plain() == ibdata.evaluate("random", setpoint=ODD, **options).plain()


def test_setpoints_of_the_table_of_episodes_are_generated(ds, tmp_path):
    """An experiment with `ds.episodes.setpoint.unique()` makes the same dataset again."""
    again = made(tmp_path / "again", setpoints=ds.episodes["setpoint"].unique())
    assert again.content_root == ds.content_root
    overridden = {"setpoints": list(ds.episodes["setpoint"].unique())}
    third = ibdata.generate(PLAIN, tmp_path / "third", workers=1, overrides=overridden)
    assert third.content_root == ds.content_root


def test_setpoints_of_the_rows_begin_rollouts(ds):
    """`rollouts({"setpoint": row.obs_setpoint, …})` is that at 20.1."""
    actions = np.zeros((1, 5, 3), np.float32)
    [point] = ds.head(1)["obs_setpoint"].to_numpy()
    state = ibdata.rollouts({"setpoint": point}, actions).state
    assert point.dtype == np.float32
    assert state.setpoint.tolist() == [ODD]


def test_setpoints_of_the_table_of_returns_are_selected_and_evaluated(ds):
    """Each row of `ds.returns()` is found again by its setpoint and its policy."""
    for row in ds.returns()["results"]:
        part = ds.select(setpoint=row["setpoint"], policy=row["policy"])
        assert part.episodes["return"].mean() == pytest.approx(row["mean_return"])


def test_policies_of_the_table_of_episodes_are_selected(ds):
    """`for label in ds.episodes.policy.unique(): ds.select(policy=label)`, and groups of pandas."""
    labels = ds.episodes["policy"].unique()
    assert [len(ds.select(policy=label)) for label in labels] == [120, 120]
    for (setpoint, policy), group in ds.episodes.groupby(["setpoint", "policy"], observed=True):
        part = ds.select(setpoint=setpoint, policy=policy)
        assert part.episodes["episode"].tolist() == group["episode"].tolist()


def test_numbers_of_the_best_episodes_are_selected(ds):
    """`ds.select(episodes=ds.episodes.nlargest(3, "return").index)` has the three best, in their order."""
    best = ds.episodes.nlargest(3, "return")
    chosen = ds.select(episodes=best.index)
    assert chosen.episodes["episode"].tolist() == sorted(best["episode"])
    assert chosen.episodes["return"].min() == ds.episodes["return"].nlargest(3).min()


def test_rows_of_a_selection_have_the_states_of_its_rows(ds):
    """The index of `to_pandas()` of a selection, and its arrays' `(episode, step)`, find the same states."""
    chosen = ds.select("test", policy="safe")
    frame, arrays = chosen.to_pandas(), chosen.arrays()
    for rows in (frame.index, (arrays["episode"], arrays["step"]), frame):
        assert np.float32(ibdata.state_at(ds, rows).fatigue).tolist() == frame["obs_fatigue"].tolist()


def test_rows_of_a_view_with_fewer_rows_have_their_states(ds):
    """Row i of such a view is another row of the dataset; `(episode, step)` stands beside it everywhere."""
    arrays, frame = ds.arrays(view=HIDDEN), ds.to_pandas(view=HIDDEN)
    windows = ds.windows(view=HIDDEN).batch(np.arange(len(frame)))
    whole = ds.to_pandas()
    expected = whole[whole["step"] < 19]["obs_fatigue"].tolist()
    for table in (arrays, frame, windows):
        rows = (np.asarray(table["episode"]), np.asarray(table["step"]))
        assert np.float32(ibdata.state_at(ds, rows).fatigue).tolist() == expected
    assert len(frame) == len(whole) - 12


# Twice, in a loop, in pieces, in another order.


def test_selecting_twice_is_selecting_both(ds):
    """`ds.select("train").select(policy="safe")`, in either order and at once."""
    one = ds.select("train").select(policy="safe")
    for other in (ds.select(policy="safe").select("train"), ds.select("train", policy="safe")):
        same(one.arrays(), other.arrays())
    assert ds.select("train").select("train").episodes.equals(ds.select("train").episodes)


def test_a_bootstrap_by_select_is_refused_and_one_by_arrays_is_right(ds):
    """`select(episodes=rng.choice(n, n))` would keep each number once, and be 37 % short."""
    drawn = np.random.default_rng(0).choice(12, 12)
    with pytest.raises(
        UsageError, match=r"^episodes: found \d+ \d times, expected each number once; for a b"
    ):
        ds.select(episodes=drawn)
    with pytest.raises(UsageError, match="found 0 20 times"):
        ds.select(episodes=ds.arrays()["episode"])  # a number for each row
    arrays = ds.arrays()
    rows = np.concatenate([np.flatnonzero(arrays["episode"] == number) for number in drawn])
    returns = arrays["rewards"][rows].reshape(12, 20).sum(axis=1)
    assert returns == pytest.approx(ds.episodes["return"].to_numpy()[drawn], rel=1e-5)


def test_rows_in_pieces_are_the_rows(ds):
    """Batches of any size, read twice, and parts by setpoint are the table."""
    whole = ds.table()
    for rows in (7, 7, 1000):
        assert pyarrow.Table.from_batches(ds.iter_batches(batch_rows=rows)).equals(whole)
    parts = [ds.select(setpoint=p).table() for p in (ODD, 70)]
    by_episode = pyarrow.concat_tables(parts).sort_by([("episode", "ascending"), ("step", "ascending")])
    assert by_episode["reward"].to_pylist() == whole["reward"].to_pylist()


def test_windows_are_the_arrays_with_their_episodes_and_steps(ds, tmp_path):
    """Shuffled, with a history, rows dropped, of a split, in a folder that is used twice."""
    order = np.random.default_rng(1).permutation(4 * 17)
    options = {"history": 4, "split": "test", "pad": "drop"}
    arrays = ds.arrays(**options)
    for _ in range(2):
        batch = ds.windows(**options, folder=tmp_path / "w").batch(order)
        same(batch, {name: array[order] for name, array in arrays.items()})


def test_a_longer_history_begins_with_the_shorter_one(ds):
    """The newest frame stands first, whatever the history."""
    short, long = ds.arrays()["observations"], ds.arrays(history=5)["observations"]
    assert np.array_equal(short, long[:, :6])


def test_setpoints_in_another_order_are_not_taken_for_the_same_windows(tmp_path):
    """Both datasets have one content root; their rows stand in another order."""
    one, other = (made(tmp_path / str(i), setpoints=points) for i, points in enumerate([[20, 70], [70, 20]]))
    assert one.content_root == other.content_root
    one.windows(folder=tmp_path / "w")
    with pytest.raises(UsageError, match="holds something else than these windows"):
        other.windows(folder=tmp_path / "w")


def test_moving_setpoints_are_selected_by_their_first_value(tmp_path):
    """The setpoint of an episode is none of its rows'."""
    moving = made(tmp_path / "m", setpoints={"drifting": [30, 60]})
    assert moving.select(setpoint=30).episodes["setpoint"].unique().tolist() == [30]
    assert moving.select(setpoint=30).to_pandas()["obs_setpoint"].nunique() > 1


# Exports.


def test_an_export_of_a_selected_split_is_that_of_the_split(ds, tmp_path):
    """`export(ds.select("test"))`, `export(ds, split="test")` and the command write the same bytes."""
    ibdata.export(ds, "npz", tmp_path / "a.npz", split="test")
    ibdata.export(ds.select("test"), "npz", tmp_path / "b.npz")
    ibdata.export(ds.select("test").select(policy="safe"), "npz", tmp_path / "c.npz")
    one, other, narrower = ((tmp_path / f"{name}.npz").read_bytes() for name in "abc")
    assert one == other != narrower
    told = [json.loads(zipfile.ZipFile(tmp_path / f"{name}.npz").comment) for name in "bc"]
    assert [(each["split"], "episodes" in each) for each in told] == [("test", False), (None, True)]


def test_an_export_has_the_rows_of_the_arrays_and_says_which(ds, tmp_path):
    """With a view of fewer rows and a history, of a selection: `episode` and `step` say which rows."""
    chosen = ds.select(episodes=[1, 7])
    ibdata.export(chosen, "npz", tmp_path / "x.npz", history=3, view=HIDDEN)
    arrays, found = chosen.arrays(history=3, view=HIDDEN), np.load(tmp_path / "x.npz")
    assert np.array_equal(found["observations"], arrays["observations"])
    assert np.array_equal(found["infos/episode"], arrays["episode"])
    assert np.array_equal(found["infos/step"], arrays["step"])


def test_an_export_is_not_replaced_without_a_word(ds, tmp_path):
    """Run twice, the second one is refused; with `overwrite` it gives the same bytes."""
    ibdata.export(ds, "csv", tmp_path / "x.csv")
    first = (tmp_path / "x.csv").read_bytes()
    with pytest.raises(UsageError, match="exists already"):
        ibdata.export(ds, "csv", tmp_path / "x.csv")
    ibdata.export(ds, "csv", tmp_path / "x.csv", overwrite=True)
    assert (tmp_path / "x.csv").read_bytes() == first


# Other readers, and who keeps a copy.


def by_polars(folder):
    return pl.scan_parquet(f"{folder}/**/*.parquet").collect()["reward"].to_numpy()


def by_duckdb(folder):
    rows = duckdb.sql(f"select reward from '{folder}/**/*.parquet'")  # of the process's own connection
    return rows.fetchnumpy()["reward"]


def by_pyarrow(folder):
    files = sorted(map(str, Path(folder).rglob("*.parquet")))
    return pyarrow.dataset.dataset(files).to_table(["reward"])["reward"].to_numpy()


def by_pandas(folder):
    return pd.concat(map(pd.read_parquet, sorted(Path(folder).rglob("*.parquet"))))["reward"].to_numpy()


@pytest.mark.parametrize("read", [by_polars, by_duckdb, by_pyarrow, by_pandas])
def test_every_parquet_file_below_the_folder_has_rows(ds, read):
    """`DIR/**/*.parquet` is the rows, and nothing else."""
    assert np.array_equal(read(ds.path), ds.arrays()["rewards"])


@pytest.mark.parametrize("read", [by_polars, by_duckdb])
def test_a_reader_finds_the_new_rows_after_overwrite(tmp_path, read):
    """The same path, number of rows and process, with another seed and with another order."""
    for changes in ({}, {"seed": 1}, {"setpoints": [70, ODD]}, {}):
        new = made(tmp_path / "p", **changes)
        assert np.array_equal(read(new.path), new.arrays()["rewards"])


def test_an_opened_dataset_that_was_replaced_is_not_read(tmp_path):
    """An old `ds` in a notebook says so, and gives no mixture."""
    old = made(tmp_path / "p")
    old.arrays()
    made(tmp_path / "p", seed=1)
    for read in (old.arrays, old.to_pandas, old.windows, lambda: list(old.iter_batches())):
        with pytest.raises(BusyError, match="replaced while it was read; open it again"):
            read()


def described(dataset):
    """The configurations of Hugging Face, by whose text it keeps its copy of the rows."""
    front = Path(dataset.path, "README.md").read_text().split("---\n")[1]
    return YAML(typ="safe", pure=True).load(front)["configs"]


def test_what_hugging_face_keeps_a_copy_by_changes_with_the_rows(tmp_path):
    """`load_dataset(DIR)` after `--overwrite`, or of a folder of the same name; tests/bridges reads it."""
    changes = ({}, {"seed": 1}, {"setpoints": [70, ODD]}, {"output": {"latent": False}}, {})
    told = [[c["description"] for c in described(made(tmp_path / "p", **change))] for change in changes]
    assert all(len(set(each)) == 1 for each in told)
    assert len({each[0] for each in told}) == len(changes) - 1  # the first and the last have the same files
