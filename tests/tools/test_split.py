"""Splits of a finished dataset: labels without copies, copies in whole files, and no leaks."""

import pyarrow.parquet as pq
import pytest
from helpers.datasets import MANY
from helpers.folders import contents

import ibdata
from ibdata.dataset import manifest
from ibdata.errors import BusyError, UsageError
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.split_schemes import by_episode
from ibdata.tools.rewrite import relabel

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
    "shots": (
        {"by": "setpoint", "source": [50, 30], "target": [75], "shots": 2},
        {"source": ({30.0, 50.0}, BOTH, ALL), "target": ({75.0}, BOTH, {0, 1}),
         "target-rest": ({75.0}, BOTH, {2, 3, 4})},
    ),
    "transitions": (
        {"by": "setpoint", "source": [50], "target": [75], "transitions": 15},  # 15 rows hold 3 episodes of 4
        {"source": ({50.0}, BOTH, ALL), "target": ({75.0}, BOTH, {0, 1, 2}),
         "target-rest": ({75.0}, BOTH, {3, 4})},
    ),
    "episode": (
        {"by": "episode", "fractions": (0.6, 0.2, 0.2)},
        {"train": (SETPOINTS, BOTH, {0, 1, 2}), "validation": (SETPOINTS, BOTH, {3}),
         "test": (SETPOINTS, BOTH, {4})},
    ),
    "policy": (
        {"by": "policy"},
        {"random": (SETPOINTS, {"random"}, ALL), "safe": (SETPOINTS, {"safe"}, ALL)},
    ),
}  # fmt: skip


@pytest.mark.parametrize(("call", "expected"), CASES.values(), ids=CASES)
def test_a_split_holds_the_episodes_asked_for_and_leaks_none(made, call, expected):
    split = ibdata.split(made.path, **call)
    assert {name: conditions(split, name) for name in expected} == expected
    assert set(split.splits) == {"low", *expected}
    assert ibdata.validate(made.path) == []


def test_each_share_of_100_episodes_has_its_number():
    """In floating point, 100 * 0.57 is below 57, and 100 * 0.07 above 7."""
    spec = DatasetSpec.of(
        ibdata.load({"name": "x", "setpoints": 70, "policies": ["random"], "episodes": 100})
    )
    for percent in range(1, 100):
        train, test = by_episode(spec, (percent / 100, (100 - percent) / 100)).values()
        assert (train.indices(100), test.indices(100)) == (range(percent), range(percent, 100))


def test_labels_replace_one_file_and_need_no_row(made):
    before = contents(made.path)
    rows, away = made.path / "data", made.path.parent / "away"
    rows.rename(away)
    split = ibdata.split(made.path, "setpoint", source=[50], target=[75], shots=2)
    away.rename(rows)
    after = contents(made.path)
    assert {path for path in after if after[path] != before.get(path)} == {str(made.path / manifest.SPLITS)}
    assert after.keys() == before.keys()
    assert split.splits["target"] == {"episodes": 4, "rows": 16, "declared": False}
    assert split.content_root == made.content_root


def test_splits_made_together_are_replaced_together(made):
    """Else a rest of the earlier scheme would share episodes with the new splits."""
    ibdata.split(made.path, by="policy")
    kept = set(ibdata.open(made.path).splits)
    ibdata.split(made.path, "setpoint", source=50, target=75, shots=1)
    ibdata.split(made.path, "setpoint", source=50, target=75, shots=1, prefix="few")
    found = ibdata.split(made.path, "setpoint", source=50, target=75).splits
    assert set(found) - kept == {"source", "target", "few-source", "few-target", "few-target-rest"}
    ibdata.split(made.path, by="episode", fractions=[0.5, 0.25, 0.25])
    found = ibdata.split(made.path, by="episode", fractions=[0.5, 0.5]).splits
    assert set(found) - kept >= {"source", "target", "train", "test"}
    assert "validation" not in found


def test_a_materialized_copy_has_splits_of_whole_files(made, tmp_path):
    ibdata.split(made.path, by="policy")
    copy = ibdata.split(
        made.path, "setpoint", source=[50], target=[75], shots=2, materialize=tmp_path / "copy"
    )
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


TRANSFER = {"by": "setpoint", "source": [50], "target": [75]}
REFUSED = [
    ({"by": "setpoint", "source": [50], "target": [50]}, "found 50 as source and target, expected different"),
    ({"by": "setpoint", "source": [50]}, "found no target, expected setpoints for both"),
    ({**TRANSFER, "shots": 6}, "found a budget of 6 episodes, expected at most 5, the episodes of each pol"),
    ({**TRANSFER, "transitions": 3}, "found 3 transitions, expected at least 4, those of an episode"),
    ({**TRANSFER, "shots": 1, "transitions": 9}, "expected one of them"),
    ({**TRANSFER, "fractions": (0.5, 0.5)}, "found --fractions, but the scheme transfer uses only --source"),
    ({**TRANSFER, "names": {"source": "low"}}, "low is a declared split"),
    ({"by": "setpoint", "scheme": "distance", "source": [50], "within": 5}, "found 0 setpoints within 5"),
    ({"by": "setpoint", "scheme": "leave-one-ou"}, "did you mean 'leave-one-out'?"),
    ({"by": "episode", "fractions": (0.9, 0.05, 0.05)}, "found 5 episodes in each cell"),
    ({"by": "policy", "names": {"saef": "x"}}, "found 'saef' to be renamed; did you mean 'safe'?"),
]


def test_what_cannot_be_meant_is_refused(made):
    """tests/corpus has more."""
    before = contents(made.path)
    for call, line in REFUSED:
        with pytest.raises(UsageError) as error:
            ibdata.split(made.path, **call)
        assert line in str(error.value)
    assert contents(made.path) == before


def test_several_schemes_live_together_under_names_of_their_own(made_at, made, tmp_path):
    ibdata.split(made.path, "setpoint", source=[50], target=[75], shots=2, prefix="near")
    at = {"source": "at-50", "target": "at-90"}
    ibdata.split(made.path, "setpoint", source=[50], target=[90], names=at)
    split = ibdata.split(made.path, by="episode", fractions=(0.6, 0.4), prefix="x", names={"test": "last"})
    names = ["low", "near-source", "near-target", "near-target-rest", "at-50", "at-90", "x-train", "last"]
    assert list(split.splits) == names
    assert conditions(split, "near-target") == ({75.0}, BOTH, {0, 1})
    assert conditions(split, "last") == (SETPOINTS, BOTH, {3, 4})
    other = made_at({**MANY, "seed": 1}, tmp_path / "other")
    merged = ibdata.merge([made.path, other.path], tmp_path / "both")
    assert list(merged.splits) == names
    assert merged.splits["near-target"]["episodes"] == 4
    assert merged.splits["near-target"]["declared"]
    ibdata.split(made.path, remove=["at-50", "at-90", "last"])
    copy = ibdata.split(made.path, materialize=tmp_path / "copy")
    assert list(copy.splits) == ["low", "near-source", "near-target", "near-target-rest", "x-train"]
    for folder in (merged.path, copy.path):
        assert ibdata.validate(folder) == []


def test_splits_that_were_made_meanwhile_are_not_lost(made, monkeypatch):
    def meanwhile(*args):
        monkeypatch.undo()
        ibdata.split(made.path, by="policy")
        return relabel(*args)

    monkeypatch.setattr("ibdata.tools.split.relabel", meanwhile)
    with pytest.raises(BusyError, match="got other splits meanwhile; split it again"):
        ibdata.split(made.path, by="episode", fractions=[0.6, 0.4])
    assert "random" in ibdata.open(made.path).splits
