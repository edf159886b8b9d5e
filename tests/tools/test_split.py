"""Splits of a finished dataset: labels without copies, copies in whole files, no leaks."""

import pyarrow.parquet as pq
import pytest
from helpers.datasets import MANY
from helpers.folders import contents
from helpers.refusals import refused
from helpers.splits import BY_POLICY, HALVES

import ibdata
from ibdata.cli.make import split_command
from ibdata.dataset import manifest
from ibdata.errors import BusyError, UsageError
from ibdata.tools.rewrite import relabel
from ibdata.tools.split_schemes import SCHEMES, by_episode, by_policy, leave_one_out, transfer

pytestmark = pytest.mark.portable

SETPOINTS = set(MANY["setpoints"])
BOTH = {"random", "safe"}
ALL = {0, 1, 2, 3, 4}


@pytest.fixture
def made(made_at, tmp_path):
    return made_at(MANY, tmp_path / "many")


def members(dataset, name):
    """The numbers of a split's episodes."""
    return [e for e, names in enumerate(dataset.episodes["splits"]) if name in names]


def conditions(dataset, name):
    """The setpoints, policies and indices of a split's episodes."""
    frame = dataset.episodes.iloc[members(dataset, name)]
    return set(frame["setpoint"]), set(frame["policy"]), set(frame["index"])


CASES = {
    "language": (
        lambda ds: {"calm": {"setpoint": [50, 30], "policy": "safe"},
                    "late": {"setpoint": 75, "episodes": "last 40%"}},
        {"calm": ({30.0, 50.0}, {"safe"}, ALL), "late": ({75.0}, BOTH, {3, 4})},
    ),
    "transfer": (
        lambda ds: transfer(ds, [50, 30], 75, shots=2),
        {"source": ({30.0, 50.0}, BOTH, ALL), "target": ({75.0}, BOTH, {0, 1}),
         "target-rest": ({75.0}, BOTH, {2, 3, 4})},
    ),
    "episode": (
        lambda ds: by_episode(ds, (0.6, 0.2, 0.2)),
        {"train": (SETPOINTS, BOTH, {0, 1, 2}), "validation": (SETPOINTS, BOTH, {3}),
         "test": (SETPOINTS, BOTH, {4})},
    ),
    "policy": (by_policy, {label: (SETPOINTS, {label}, ALL) for label in BOTH}),
    "leave-one-out": (
        leave_one_out,
        {f"test-{p:g}": ({p}, BOTH, ALL) for p in SETPOINTS}
        | {f"train-{p:g}": (SETPOINTS - {p}, BOTH, ALL) for p in SETPOINTS},
    ),
}  # fmt: skip


def test_each_scheme_has_its_case_and_its_word_in_the_command():
    (by,) = (option for option in split_command.params if option.name == "by")
    assert list(by.type.choices) == list(SCHEMES)
    assert set(SCHEMES) < set(CASES)


@pytest.mark.parametrize(("splits", "expected"), CASES.values(), ids=CASES)
def test_a_split_holds_the_episodes_asked_for_and_leaks_none(made, splits, expected):
    split = ibdata.split(made.path, splits(made))
    assert {name: conditions(split, name) for name in expected} == expected
    assert set(split.splits) == {"low", *expected}
    assert ibdata.validate(made.path) == []


def test_each_share_of_100_episodes_has_its_number(made_at, tmp_path):
    """In floating point, 100 * 0.57 is below 57, and 100 * 0.07 above 7."""
    plain = {"name": "x", "setpoints": 70, "policies": ["random"], "episodes": 100, "steps": 1}
    ds = made_at(plain, tmp_path / "x")
    for percent in range(1, 100):
        made = by_episode(ds, (percent / 100, (100 - percent) / 100))
        assert made == {
            "train": {"episodes": {"start": 0, "stop": percent - 1}},
            "validation": None,
            "test": {"episodes": {"start": percent, "stop": 99}},
        }


def test_labels_replace_two_files_and_need_no_row(made):
    before = contents(made.path)
    rows, away = made.path / "data", made.path.parent / "away"
    rows.rename(away)
    split = ibdata.split(made.path, transfer(made, 50, 75, shots=2))
    away.rename(rows)
    after = contents(made.path)
    own = {str(made.path / name) for name in (manifest.SPLITS, manifest.CARD)}
    assert {path for path in after if after[path] != before.get(path)} == own
    assert after.keys() == before.keys()
    assert split.splits["target"] == {"episodes": 4, "rows": 16, "declared": False}
    assert split.content_root == made.content_root


def test_splits_made_together_are_replaced_together(made):
    """Else a rest of the earlier scheme would share episodes with the new splits."""
    ibdata.split(made.path, BY_POLICY)
    kept = set(ibdata.open(made.path).splits)
    few = transfer(made, 50, 75, shots=1)
    ibdata.split(made.path, few)
    ibdata.split(made.path, {f"few-{name}": each for name, each in few.items()})
    found = ibdata.split(made.path, transfer(made, 50, 75)).splits
    assert set(found) - kept == {"source", "target", "few-source", "few-target", "few-target-rest"}
    ibdata.split(made.path, by_episode(made, [0.5, 0.25, 0.25]))
    found = ibdata.split(made.path, by_episode(made, [0.5, 0.5])).splits
    assert set(found) - kept >= {"source", "target", "train", "test"}
    assert "validation" not in found


def test_a_materialized_copy_has_splits_of_whole_files(made, tmp_path):
    ibdata.split(made.path, BY_POLICY)
    copy = ibdata.split(made.path, transfer(made, 50, 75, shots=2), materialize=tmp_path / "copy")
    assert copy.content_root == made.content_root
    assert list(ibdata.open(made.path).splits) == ["low", "random", "safe"]
    for name, split in copy.splits.items():
        files = [shard["path"] for shard in copy.manifest["shards"] if name in shard["splits"]]
        frames = [pq.read_table(copy.path / file).to_pandas() for file in files]
        assert sum(map(len, frames)) == split["rows"]
        own = copy.episodes.iloc[members(copy, name)]
        assert {e for frame in frames for e in frame["episode"]} == set(own["episode"])
        assert f"config_name: {name}" in (copy.path / "README.md").read_text()
    assert ibdata.validate(copy.path) == []
    assert ibdata.reproduce(copy.path) == (50, [])


REFUSED = [
    ({"a": {"setpoint": 31}}, "split a.setpoint: found 31, expected one of the setpoints 10, 30, 50, 75, 90"),
    ({"a": {"policy": "saef"}}, "split a.policy: found 'saef'; did you mean 'safe'?"),
    ({"a": {"episodes": 6}}, "split a.episodes: found episodes 0 to 5, expected some of 0 to 4"),
    ({"a": {"setpoint": 50}, "b": {"policy": "safe"}}, "split b: shares episodes with a"),
    ({"low": {"setpoint": 50}}, "low is a declared split"),
    ({"Low": {"setpoint": 50}}, "split Low: found 'Low', expected a name of a-z"),
    ({}, "split: found nothing to do"),
]


def test_what_cannot_be_meant_is_refused(made):
    """tests/corpus has more."""
    before = contents(made.path)
    for splits, line in REFUSED:
        with pytest.raises(UsageError) as error:
            ibdata.split(made.path, splits)
        assert line in str(error.value)
    assert contents(made.path) == before


def test_labels_are_removed_and_copied(made, tmp_path):
    ibdata.split(made.path, {**BY_POLICY, "at-50": {"setpoint": 50, "overlap": True}})
    ibdata.split(made.path, {"safe": None, "safer": None}, remove="random")
    copy = ibdata.split(made.path, materialize=tmp_path / "copy")
    assert list(copy.splits) == ["low", "at-50"]
    assert ibdata.validate(copy.path) == []


def test_splits_that_were_made_meanwhile_are_not_lost(made, monkeypatch):
    def meanwhile(*args):
        monkeypatch.undo()
        ibdata.split(made.path, BY_POLICY)
        return relabel(*args)

    monkeypatch.setattr("ibdata.tools.split.relabel", meanwhile)
    refused("got other splits meanwhile; split it again", ibdata.split, made.path, HALVES, error=BusyError)
    assert "random" in ibdata.open(made.path).splits
