"""Splits of a finished dataset: labels without copies, copies in whole files, and no leaks."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pyarrow.parquet as pq
import pytest

import ibdata
from ibdata import Experiment
from ibdata.errors import DatasetError, UsageError
from ibdata.maintenance.repair import repair

SETPOINTS = [10.0, 30.0, 50.0, 75.0, 90.0]


@pytest.fixture(scope="module")
def experiment():
    return Experiment.model_validate(
        {
            "name": "many",
            "setpoints": SETPOINTS,
            "policies": [{"kind": "random"}, {"kind": "safe"}],
            "episodes": 5,
            "steps": 4,
            "output": {"shard_rows": 40},
            "splits": {"low": {"setpoint": [10, 30], "overlap": True}},
        }
    )


@pytest.fixture
def made(experiment, tmp_path):
    return ibdata.generate(experiment, tmp_path / "many", workers=1)


def members(dataset, name):
    """The numbers of a split's episodes."""
    return [e for e, names in enumerate(dataset.episodes["splits"]) if name in names]


def conditions(dataset, name):
    frame = dataset.episodes.iloc[members(dataset, name)]
    return set(frame["setpoint"]), set(frame["policy"]), set(frame["index"])


BOTH = {"random", "safe"}
ALL = {0, 1, 2, 3, 4}
CASES = {
    "transfer": (
        {"source": [50], "target": [75]},
        {"source": ({50.0}, BOTH, ALL), "target": ({75.0}, BOTH, ALL)},
    ),
    "shots": (
        {"source": [50, 30], "target": [75], "shots": 2},
        {"source": ({30.0, 50.0}, BOTH, ALL), "target": ({75.0}, BOTH, {0, 1}),
         "target-rest": ({75.0}, BOTH, {2, 3, 4})},
    ),
    "transitions": (
        {"source": [50], "target": [75], "transitions": 15},  # 15 rows hold 3 episodes of 4
        {"source": ({50.0}, BOTH, ALL), "target": ({75.0}, BOTH, {0, 1, 2}),
         "target-rest": ({75.0}, BOTH, {3, 4})},
    ),
    "all shots": (
        {"source": [50], "target": [75], "shots": 5},
        {"source": ({50.0}, BOTH, ALL), "target": ({75.0}, BOTH, ALL)},
    ),
    "interpolation": (
        {"scheme": "interpolation"},
        {"train": ({10.0, 50.0, 90.0}, BOTH, ALL), "test": ({30.0, 75.0}, BOTH, ALL)},
    ),
    "extrapolation": (
        {"scheme": "extrapolation"},
        {"train": ({30.0, 50.0, 75.0}, BOTH, ALL), "test": ({10.0, 90.0}, BOTH, ALL)},
    ),
    "distance": (
        {"scheme": "distance", "source": [50], "within": 25},
        {"source": ({50.0}, BOTH, ALL), "near": ({30.0, 75.0}, BOTH, ALL), "far": ({10.0, 90.0}, BOTH, ALL)},
    ),
    "episode": (
        {"by": "episode", "fractions": (0.6, 0.2, 0.2)},
        {"train": (set(SETPOINTS), BOTH, {0, 1, 2}), "validation": (set(SETPOINTS), BOTH, {3}),
         "test": (set(SETPOINTS), BOTH, {4})},
    ),
    "policy": (
        {"by": "policy"},
        {"random": (set(SETPOINTS), {"random"}, ALL), "safe": (set(SETPOINTS), {"safe"}, ALL)},
    ),
}  # fmt: skip


@pytest.mark.parametrize(("call", "expected"), CASES.values(), ids=CASES)
def test_a_split_holds_the_episodes_asked_for_and_leaks_none(made, call, expected):
    split = ibdata.split(made.path, **call)
    assert {name: conditions(split, name) for name in expected} == expected
    for a, b in combinations(expected, 2):
        assert not set(members(split, a)) & set(members(split, b))
        digests = [{split.digests[e] for e in members(split, name)} for name in (a, b)]
        assert not digests[0] & digests[1]
    assert set(split.info["splits"]) == {"low", *expected}
    assert ibdata.validate(made.path) == []


def test_leave_one_out_makes_a_fold_for_every_setpoint(made):
    split = ibdata.split(made.path, scheme="leave-one-out")
    for p in SETPOINTS:
        test, train = (conditions(split, f"{part}-{p:g}")[0] for part in ("test", "train"))
        assert (test, train) == ({p}, set(SETPOINTS) - {p})


def test_close_setpoints_have_folds_of_their_own_and_are_told_apart(experiment, tmp_path):
    close = {**experiment.plain(), "setpoints": [50.0000001, 50.0000002, 60.0], "splits": {}}
    made = ibdata.generate(Experiment.model_validate(close), tmp_path / "close", workers=1)
    split = ibdata.split(made.path, scheme="leave-one-out")
    names = [f"{part}-{p}" for p in ("50_0000001", "50_0000002", "60") for part in ("train", "test")]
    assert list(split.info["splits"]) == names
    assert conditions(split, "test-50_0000002")[0] == {50.0000002}
    assert ibdata.validate(made.path) == []
    with pytest.raises(UsageError) as error:
        ibdata.split(made.path, source=[50.0], target=[60.0])
    assert "found setpoint 50, expected one of 50.0000001, 50.0000002, 60" in str(error.value)


def test_labels_change_no_row_and_no_root(made):
    before = {path.name: path.read_bytes() for path in (made.path / "data").iterdir()}
    split = ibdata.split(made.path, source=[50], target=[75], shots=2)
    assert {path.name: path.read_bytes() for path in (made.path / "data").iterdir()} == before
    assert split.content_root == made.content_root
    assert split.info["splits"]["target"] == {"episodes": 4, "rows": 16, "files": None}
    assert "config_name: target" not in (made.path / "README.md").read_text()
    assert not list(made.path.rglob(".next*"))


def test_a_labelled_split_is_read_by_every_reader_and_no_other_row(made):
    split = ibdata.split(made.path, source=[50], target=[75], shots=2)
    frame = split.to_pandas()
    expected = frame[frame["episode"].isin(members(split, "target"))]
    assert len(expected) == 16
    assert split.to_pandas(split="target")["reward"].tolist() == expected["reward"].tolist()
    for rows in (1, 7, 1000):
        batches = list(split.iter_batches(["episode", "reward"], "target", rows))
        assert [x for batch in batches for x in batch.column(1).to_pylist()] == expected["reward"].tolist()
        assert max(batch.num_rows for batch in batches) <= rows
    arrays = split.arrays(history=3, split="target")
    assert arrays["rewards"].tolist() == expected["reward"].tolist()
    np.testing.assert_array_equal(
        arrays["observations"][0].reshape(3, 6)[0], arrays["observations"][0].reshape(3, 6)[2]
    )
    assert split.statistics("target")["reward"]["count"] == 16
    assert split.statistics("target")["reward"]["mean"] == pytest.approx(expected["reward"].mean())


def test_splits_add_up_and_one_of_the_same_name_is_replaced(made):
    ibdata.split(made.path, by="policy")
    ibdata.split(made.path, source=[50], target=[75])
    split = ibdata.split(made.path, source=[10], target=[90])
    assert list(split.info["splits"]) == ["low", "random", "safe", "source", "target"]
    assert conditions(split, "source")[0] == {10.0}
    assert ibdata.validate(made.path) == []


@pytest.mark.parametrize(
    "damage",
    ["meta/stats.json", "meta/episodes.parquet", "meta/info.json", "README.md", "shard"],
)
def test_what_a_split_changed_is_repaired_with_it(made, shard_file, damage):
    split = ibdata.split(made.path, source=[50], target=[75], shots=2)
    file = shard_file(split.path, 2) if damage == "shard" else damage
    path = split.path / file
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert repair(split.path, workers=1) == [file]
    assert path.read_bytes() == whole
    assert ibdata.validate(split.path) == []


def test_a_materialized_copy_has_the_same_root_and_splits_of_whole_files(made, tmp_path):
    ibdata.split(made.path, by="policy")
    copy = ibdata.split(made.path, source=[50], target=[75], shots=2, materialize=tmp_path / "copy")
    assert copy.content_root == made.content_root
    assert list(ibdata.open(made.path).info["splits"]) == ["low", "random", "safe"]
    for name, split in copy.info["splits"].items():
        frames = [pq.read_table(copy.path / file).to_pandas() for file in split["files"]]
        assert sum(map(len, frames)) == split["rows"]
        own = copy.episodes.iloc[members(copy, name)]
        assert {e for frame in frames for e in frame["episode"]} == set(own["episode"])
        assert f"config_name: {name}" in (copy.path / "README.md").read_text()
    assert ibdata.validate(copy.path) == []
    assert ibdata.reproduce(copy.path) == (50, [])
    again = ibdata.generate(copy.path / "meta/experiment.yaml", tmp_path / "again", workers=1)
    assert [s["content"] for s in again.manifest["shards"]] == [s["content"] for s in copy.manifest["shards"]]


def test_the_labels_that_are_there_can_be_materialized_by_themselves(made, tmp_path):
    ibdata.split(made.path, by="policy")
    copy = ibdata.split(made.path, None, materialize=tmp_path / "copy")
    assert copy.info["splits"]["safe"]["files"]


@pytest.mark.parametrize(
    ("call", "line"),
    [
        ({"source": [50], "target": [50]}, "found 50 as source and target, expected different"),
        ({"source": [50]}, "found none as source and target"),
        ({"source": [50], "target": [70]}, "found setpoint 70, expected one of 10, 30, 50, 75, 90"),
        (
            {"source": [50], "target": [75], "shots": 6},
            "found a budget of 6 episodes, expected at most the 5",
        ),
        ({"source": [50], "target": [75], "shots": 0}, "found 0 shots, expected at least 1"),
        (
            {"source": [50], "target": [75], "transitions": 3},
            "found 3 transitions, expected at least those of an episode",
        ),
        ({"source": [50], "target": [75], "shots": 1, "transitions": 9}, "expected one of them"),
        ({"scheme": "distance", "source": [50]}, "needs both source=… and within=…"),
        ({"scheme": "distance", "source": [50], "within": 5}, "found 0 setpoints within 5"),
        ({"scheme": "nearest"}, "found the scheme 'nearest', expected one of transfer"),
        ({"by": "episode", "fractions": (0.5, 0.499999)}, "found fractions 0.5, 0.499999, expected 2 or 3"),
        ({"by": "episode", "fractions": (0.9, 0.05, 0.05)}, "found 5 episodes in each cell"),
        ({"by": "episode", "fractions": (1.1, -0.1)}, "found fractions 1.1, -0.1"),
        ({"by": "colour"}, "found 'colour', expected by setpoint, episode or policy"),
        ({"by": None}, "found nothing, expected by setpoint"),
    ],
)
def test_what_cannot_be_meant_is_refused_and_changes_nothing(made, call, line):
    before = {path: path.read_bytes() for path in made.path.rglob("*") if path.is_file()}
    with pytest.raises(UsageError, match=r"^split: ") as error:
        ibdata.split(made.path, **call)
    assert line in str(error.value)
    assert {path: path.read_bytes() for path in made.path.rglob("*") if path.is_file()} == before


def test_a_name_of_a_declared_split_is_refused(experiment, tmp_path):
    plain = {**experiment.plain(), "splits": {"train": {"setpoint": [10.0]}}}
    ibdata.generate(Experiment.model_validate(plain), tmp_path / "x", workers=1)
    with pytest.raises(UsageError, match="train is a declared split"):
        ibdata.split(tmp_path / "x", scheme="interpolation")


def test_rows_that_are_not_those_listed_are_refused_and_nothing_is_changed(made, shard_file, tmp_path):
    path = made.path / shard_file(made.path, 1)
    table = pq.read_table(path)
    pq.write_table(table.take(list(range(len(table)))[::-1]), path)
    before = {path: path.read_bytes() for path in made.path.rglob("*") if path.is_file()}
    for materialize in (None, tmp_path / "copy"):
        with pytest.raises(DatasetError, match="found other content than it lists; see ibdata validate"):
            ibdata.split(made.path, by="policy", materialize=materialize)
    assert {path: path.read_bytes() for path in made.path.rglob("*") if path.is_file()} == before
    assert not (tmp_path / "copy").exists()
