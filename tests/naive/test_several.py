"""What people do with several datasets in a normal year: sweeps of seeds, and many sets for pretraining."""

import os
import pickle
import shutil

import duckdb
import numpy as np
import polars as pl
import pyarrow as pa
import pytest

import ibdata
from ibdata.errors import ArgumentError, BusyError, DatasetError, UsageError
from ibdata.tools import split_schemes

ODD = 20.1  # which float32 cannot hold
PLAIN = {
    "name": "a",
    "setpoints": [ODD, 70],
    "policies": ["random", "safe"],
    "episodes": 3,
    "steps": 20,
    "output": {"shard_rows": 60},
    "splits": {"train": {"episodes": 2}, "test": {"episodes": "last 33%"}},
}
OTHER = {"seed": 1, "policies": ["safe", "expert"]}
FIRST = range(12)  # the episodes of the first dataset
IN_C = np.array([3, 4, 5, 9, 10, 11])  # the episodes at setpoint 70
HIDDEN = {"observe": "markov", "reward_scale": 0.01}  # which leaves out the last row of an episode


def made(place, **changes):
    return ibdata.generate({**PLAIN, "name": place.name, **changes}, place, workers=1, overwrite=True)


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    folder = tmp_path_factory.mktemp("several")
    return made(folder / "a"), made(folder / "b", **OTHER)


@pytest.fixture(scope="module")
def merged(pair, tmp_path_factory):
    return ibdata.merge(pair, tmp_path_factory.mktemp("merged") / "both")


@pytest.fixture(scope="module")
def ds(pair):
    return ibdata.open([str(each.path) for each in pair])


def same(found, expected):
    assert found.keys() == expected.keys()
    assert all(np.array_equal(found[name], expected[name]) for name in found)


# They are read as the merged dataset.


def test_several_opened_as_one_have_the_rows_of_the_merged_dataset(ds, merged):
    """`ibdata.open(["a", "b"])`, read twice, is what `ibdata.merge(["a", "b"], "both")` writes."""
    assert (len(ds), ds.content_root) == (480, merged.content_root)
    assert ds.info["counts"] == merged.info["counts"]
    for _ in range(2):
        assert ds.table().equals(merged.table())
    assert ds.select(policy="safe").to_pandas().equals(merged.select(policy="safe").to_pandas())
    assert ds.episodes.equals(merged.episodes)
    assert ds.head(3, at=(13, 5)).equals(merged.head(3, at=(13, 5)))
    assert repr(ds) == f"<ibdata.Dataset {ds.place}: 480 rows, 24 episodes>"
    assert ds.place.endswith("a and 1 more")


def test_their_order_is_that_of_the_list(pair):
    """`open([b, a])` has the rows of b first; the content is the same."""
    a, b = (each.arrays()["rewards"].tolist() for each in pair)
    one, other = ibdata.open(pair), ibdata.open(pair[::-1])
    assert (one.arrays()["rewards"].tolist(), other.arrays()["rewards"].tolist()) == (a + b, b + a)
    assert other.episodes["episode"].tolist() == other.table()["episode"].unique().to_pylist() == [*range(24)]
    assert one.content_root == other.content_root


def test_seeds_of_a_sweep_are_opened_in_a_loop(tmp_path):
    """`open([open(x) for x in folders])`, `open(folder.glob("*"))` and `open([open([a, b]), c])` are one."""
    parts = [made(tmp_path / "sweep" / str(seed), seed=seed, steps=5) for seed in range(3)]
    whole = ibdata.open(parts)
    rewards = np.concatenate([part.arrays()["rewards"] for part in parts])
    for places in (
        sorted((tmp_path / "sweep").glob("[0-9]")),
        (part.path for part in parts),
        [ibdata.open(parts[:2]), parts[2]],
        np.array([str(part.path) for part in parts]),
    ):
        assert ibdata.open(places).table().equals(whole.table())
    assert np.array_equal(whole.arrays()["rewards"], rewards)
    assert [row["episodes"] for row in whole.returns()["results"]] == [9] * 4


def test_conditions_hold_for_all_of_them(ds, merged):
    """By setpoint, policy, split, number and return, one after another and at once."""
    for conditions in (
        {"setpoint": ODD},
        {"policy": ["random", "expert"]},
        {"split": "test", "policy": "safe"},
        {"episodes": range(9, 15)},
        {"returns": (None, ds.episodes["return"].median())},
    ):
        found, expected = ds.select(**conditions), merged.select(**conditions)
        same(found.arrays(columns=["policy"]), expected.arrays(columns=["policy"]))
        assert found.episodes.equals(expected.episodes)
    assert ds.select(policy="random").select("train").episodes["episode"].tolist() == [0, 1, 3, 4]
    with pytest.raises(UsageError, match="policy: found 'bad', expected one of random, safe, expert"):
        ds.select(policy="bad")


def test_a_selection_in_the_list_is_one_of_the_whole(pair, ds):
    """`open([a.select(policy="safe"), b])` has the numbers of `open([a, b])`, as if chosen afterwards."""
    found = ibdata.open([pair[0].select("train", policy="safe"), pair[1]])
    chosen = ds.select(episodes=[6, 7, 9, 10, *range(12, 24)])
    same(found.arrays(), chosen.arrays())
    assert found.select(episodes=FIRST).episodes["episode"].tolist() == [6, 7, 9, 10]
    with pytest.raises(UsageError, match="found episodes that were chosen by their returns"):
        ibdata.noise_floor(ibdata.open([pair[0].select(returns=(-1e9, -3000)), pair[1]]))


def test_histories_never_cross_from_one_dataset_into_the_next(pair, ds):
    """The first rows of the second repeat its own first frame, in arrays and in windows."""
    arrays, own = ds.arrays(history=5), pair[1].arrays(history=5)
    assert np.array_equal(arrays["observations"][240:], own["observations"])
    assert np.array_equal(
        ds.arrays(history=5, pad="drop")["observations"][192:], own["observations"][own["step"] > 3]
    )
    windows = ds.windows(history=5)
    same(windows.batch(range(480)), arrays)


def test_windows_in_a_folder_are_those_of_the_merged_dataset(ds, merged, tmp_path):
    """Shuffled as a `DataLoader` does, sliced, in a folder that is used again, and pickled for workers."""
    order = np.random.default_rng(0).permutation(480)
    arrays = merged.arrays(history=3)
    for dataset in (ds, merged):
        windows = dataset.windows(history=3, folder=tmp_path / "w")
        for each in (windows, pickle.loads(pickle.dumps(windows))):
            same(each.__getitems__(order.tolist()).arrays, {name: x[order] for name, x in arrays.items()})
            same(each[230:250], {name: x[230:250] for name, x in arrays.items()})
    with pytest.raises(UsageError, match="holds something else than these windows"):
        ds.select("train").windows(history=3, folder=tmp_path / "w")


def test_batches_have_the_rows_in_order_for_other_libraries(ds):
    """polars and duckdb read `iter_batches`, though each dataset has policies of its own."""
    batches = list(ds.iter_batches(batch_rows=70))
    table, expected = pa.Table.from_batches(batches), ds.to_pandas()
    assert table["policy"].to_pylist() == expected["policy"].tolist()
    assert pl.from_arrow(table)["policy"].to_list() == expected["policy"].tolist()
    reader = pa.RecordBatchReader.from_batches(batches[0].schema, ds.iter_batches(batch_rows=70))
    found = duckdb.from_arrow(reader).aggregate("policy, sum(reward)").fetchall()
    assert dict(found) == pytest.approx(expected.groupby("policy", observed=True)["reward"].sum().to_dict())


def test_a_view_shows_all_of_them(ds, merged):
    """With the hidden state, another scale, a cost, and noise that depends on the episode's number."""
    noisy = {"imperfections": {"noise": {"obs_velocity": 0.5}}, "cost": {"fatigue": 30}}
    for view in (HIDDEN, noisy):
        same(ds.arrays(view=view), merged.arrays(view=view))
        assert ds.to_pandas(view=view).equals(merged.to_pandas(view=view))


def test_a_subclass_opens_them_and_a_copy_reads_them(ds, pair):
    """`class Mine(ibdata.Dataset)`, and the object that is pickled for another process."""

    class Mine(ibdata.Dataset):
        def best(self):
            return self.select(episodes=[self.episodes["return"].argmax()])

    mine = Mine(list(pair))
    assert type(mine.best()) is Mine
    assert mine.best().episodes["return"].max() == ds.episodes["return"].max()
    assert pickle.loads(pickle.dumps(ds)).table().equals(ds.table())


# They are measured and exported.


def test_measures_are_those_of_the_merged_dataset(ds, merged):
    """Returns, statistics, quality, importance and the noise floor."""
    assert ds.returns() == merged.returns()
    assert ds.statistics() == merged.statistics()
    assert ds.statistics("test") == merged.statistics("test")
    assert ibdata.quality(ds) == ibdata.quality(merged)
    assert ibdata.quality(ds.select(policy="safe")) == ibdata.quality(merged.select(policy="safe"))
    assert ibdata.noise_floor(ds).plain() == ibdata.noise_floor(merged).plain()
    found, expected = (ibdata.importance(x.select(policy="random"), "random", steps=3) for x in (ds, merged))
    assert found.plain() == expected.plain()


def test_states_of_rows_and_episodes_are_those_of_their_dataset(ds, pair):
    """`state_at` of rows, and rollouts and true values from them."""
    rows = ds.select(policy="expert").to_pandas().sample(4, random_state=0)
    state = ibdata.state_at(ds, rows)
    assert np.float32(state.fatigue).tolist() == rows["obs_fatigue"].tolist()
    assert ibdata.state_at(pair[1], (3, 7)).fatigue == ibdata.state_at(ds, (15, 7)).fatigue
    actions = np.zeros((1, 2, 3), np.float32)
    found, own = (
        (
            ibdata.rollouts(x, actions, rows=row).rewards.tolist(),
            ibdata.true_values(x, row, "safe", steps=2, episodes=2).values.tolist(),
        )
        for x, row in ((ds, (15, 7)), (pair[1], (3, 7)))
    )
    assert found == own


@pytest.mark.parametrize("to", ["npz", "csv"])
def test_an_export_is_that_of_the_merged_dataset(ds, merged, tmp_path, to):
    """All of them, as one file with the same bytes."""
    for name, dataset in (("a", ds), ("b", merged)):
        assert ibdata.export(dataset, to, tmp_path / name).rows == 480
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


# Splits, and changes beside them.


def test_splits_of_one_name_are_joined(pair, tmp_path):
    """Whole files of one dataset, labels of another, and labels that are made after both were opened."""
    a, b = pair[0], shutil.copytree(pair[1].path, tmp_path / "b")
    ds = ibdata.open([a, b])
    assert dict(ds.splits["test"]) == {"episodes": 8, "rows": 160, "declared": True}
    ibdata.split(b, split_schemes.by_policy(b))
    halves = split_schemes.by_episode(b, fractions=[0.5, 0.5])
    ibdata.split(b, {f"x-{name}": split for name, split in halves.items()})
    c = made(tmp_path / "c", seed=2, steps=5, splits={"x-train": {"setpoint": 70}})
    assert {name: split["episodes"] for name, split in ds.splits.items()}["expert"] == 6
    labelled = ibdata.open(b).select("x-train").episodes["episode"]
    for places, numbers in (([c, b], [*IN_C, *(12 + labelled)]), ([b, c], [*labelled, *(12 + IN_C)])):
        both = ibdata.open(places)
        assert both.info["counts"]["steps"] is None
        assert both.splits["x-train"] == {"episodes": 6 + 8, "rows": 30 + 160, "declared": False}
        chosen = both.select("x-train").episodes
        assert chosen["episode"].tolist() == numbers
        assert all(names.count("x-train") == 1 for names in chosen["splits"].map(list))


def test_a_dataset_that_is_replaced_later_is_not_read(tmp_path):
    """One of them is made again with another seed: reading says so, and gives no mixture."""
    made(tmp_path / "a", steps=5)
    made(tmp_path / "b", steps=5, **OTHER)
    ds = ibdata.open([tmp_path / "a", tmp_path / "b"])
    ds.arrays()
    made(tmp_path / "b", steps=5, seed=2)
    for read in (ds.arrays, ds.to_pandas, ds.windows, lambda: list(ds.iter_batches())):
        with pytest.raises(BusyError, match="b: replaced while it was read; open it again"):
            read()
    assert ds.select(episodes=FIRST).arrays()["episode"].max() == 11  # the first one still is


def test_a_lost_file_is_named_by_its_place(tmp_path, pair):
    """Reading rows of a damaged dataset names the file, and those of the other are read."""
    b = shutil.copytree(pair[1].path, tmp_path / "b")
    next((b / "data").glob("*.parquet")).unlink()
    ds = ibdata.open([pair[0], b])
    with pytest.raises(DatasetError, match=rf"^{b}/data/part-.*: .*see ibdata validate"):
        ds.arrays()
    assert len(ds.select(policy="random").arrays()["rewards"]) == 120


def test_urls_and_folders_are_opened_together(pair, ds, monkeypatch):
    """`open(["file:///data/a", "b"])`, with a plain name of data/."""
    monkeypatch.chdir(pair[1].path.parent)
    found = ibdata.open([pair[0].path.as_uri(), "b"])
    assert found.table().equals(ds.table())
    assert repr(found).startswith("<ibdata.Dataset file:///")


# What is refused, in one line.


def test_one_in_a_list_is_that_one_and_none_is_refused(pair):
    """A loop that finds one dataset, or none."""
    one = ibdata.open([pair[0]])
    assert (one.path, one.info["name"], repr(one)) == (pair[0].path, "a", repr(pair[0]))
    with pytest.raises(UsageError, match=r"^path: found an empty list, expected at least one place$"):
        ibdata.open([])


def test_a_pattern_is_no_place(pair, monkeypatch):
    """`ibdata.open("data/*")`: the line says what makes the list."""
    monkeypatch.chdir(pair[0].path.parent)
    for place in ("*", ["*"]):
        with pytest.raises(DatasetError, match=r"of places, such as sorted\(glob.glob\('\*'\)\)$"):
            ibdata.open(place)
    for place in ({"a": pair[0]}, [1], 1):
        with pytest.raises(ArgumentError, match="expected a text, a path or a list of texts or paths"):
            ibdata.open(place)


def test_what_merge_refuses_is_refused(pair, tmp_path):
    """The same dataset twice, a copy of it, one seed twice, another system, and other columns."""
    a, b = pair
    copy = ibdata.split(a, split_schemes.by_policy(a), materialize=tmp_path / "copy")
    other = {"dynamics": "paper"}, {"start": "uniform"}, {"output": {"latent": False}}, {"seed": 0}
    refused = [
        [a, a],
        [b, a.path, a],
        [a.select("train"), a.select("test")],
        [a, copy],
        [ibdata.open(pair), b],
    ]
    refused += [
        [a, made(tmp_path / f"c{i}", **{"seed": 2, "steps": 5, **changes})] for i, changes in enumerate(other)
    ]
    for places in refused:
        with pytest.raises(UsageError, match=r"the same episodes are also in|expected .* as in"):
            ibdata.open(places)
    with pytest.raises(UsageError, match="the same episodes are also in"):
        ibdata.merge([a, copy], tmp_path / "no")


def test_a_call_for_one_place_refuses_several(ds, merged, tmp_path):
    """What checks, mends, labels or shows a folder, and what wants a path, names `ibdata.merge`."""
    for call in (
        ibdata.validate,
        ibdata.repair,
        ibdata.reproduce,
        ibdata.card,
        ibdata.open,
        lambda x: ibdata.split(x, {"first": {"episodes": 1}}),
        lambda x: ibdata.merge([x, x], tmp_path / "no"),
        lambda x: x.path,
        os.fspath,
    ):
        with pytest.raises(
            UsageError, match=r"^[^\n]*several datasets opened as one, .*ibdata.merge makes one$"
        ):
            call(ds)
