"""Splits of a finished dataset: labels without copies, copies in whole files, no leaks, definitions."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers.datasets import MANY
from helpers.folders import contents

import ibdata
from ibdata.dataset import manifest
from ibdata.errors import BusyError, UsageError
from ibdata.experiment import Experiment
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fields import Split
from ibdata.experiment.split_schemes import by_episode, distance, extrapolation, interpolation, leave_one_out
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


def test_labels_replace_two_files_and_need_no_row(made):
    before = contents(made.path)
    rows, away = made.path / "data", made.path.parent / "away"
    rows.rename(away)
    split = ibdata.split(made.path, "setpoint", source=[50], target=[75], shots=2)
    away.rename(rows)
    after = contents(made.path)
    own = {str(made.path / name) for name in (manifest.SPLITS, manifest.CARD)}
    assert {path for path in after if after[path] != before.get(path)} == own
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


def test_several_schemes_live_together_under_names_of_their_own(made, tmp_path):
    ibdata.split(made.path, "setpoint", source=[50], target=[75], shots=2, prefix="near")
    at = {"source": "at-50", "target": "at-90"}
    ibdata.split(made.path, "setpoint", source=[50], target=[90], names=at)
    split = ibdata.split(made.path, by="episode", fractions=(0.6, 0.4), prefix="x", names={"test": "last"})
    names = ["low", "near-source", "near-target", "near-target-rest", "at-50", "at-90", "x-train", "last"]
    assert list(split.splits) == names
    assert conditions(split, "near-target") == ({75.0}, BOTH, {0, 1})
    assert conditions(split, "last") == (SETPOINTS, BOTH, {3, 4})
    ibdata.split(made.path, remove=["at-50", "at-90", "last"])
    copy = ibdata.split(made.path, materialize=tmp_path / "copy")
    assert list(copy.splits) == ["low", "near-source", "near-target", "near-target-rest", "x-train"]
    assert ibdata.validate(copy.path) == []


def test_splits_that_were_made_meanwhile_are_not_lost(made, monkeypatch):
    def meanwhile(*args):
        monkeypatch.undo()
        ibdata.split(made.path, by="policy")
        return relabel(*args)

    monkeypatch.setattr("ibdata.tools.split.relabel", meanwhile)
    with pytest.raises(BusyError, match="got other splits meanwhile; split it again"):
        ibdata.split(made.path, by="episode", fractions=[0.6, 0.4])
    assert "random" in ibdata.open(made.path).splits


LABELS = ("random", "safe")


def spec_of(setpoints, episodes=2, **more):
    plain = {"name": "x", "setpoints": setpoints, "policies": LABELS, "steps": 2, "episodes": episodes}
    return DatasetSpec.of(Experiment.model_validate({**plain, **more}))


def episodes_of(spec):
    """The setpoint, the label and the index in its cell of each episode, in the order of a dataset."""
    (experiment,) = spec.experiments
    return [(cell.setpoint, cell.label, i) for cell in experiment.cells for i in range(experiment.episodes)]


def laters(spec, splits):
    """The episodes of splits that are made later."""
    runs = replace(spec, later=splits).later_runs()
    every = episodes_of(spec)
    return {name: {e for run in own for e in every[run.first : run.stop]} for name, own in runs.items()}


@pytest.mark.parametrize("count", [3, 6, 9])
def test_schemes_hold_out_the_setpoints_that_they_say(count):
    points = np.random.default_rng(count).permutation(101)[:count].astype(float).tolist()
    spec, known = spec_of(points), set(points)
    rank = {p: sum(q < p for q in known) for p in known}
    ends, middle = {p for p in known if rank[p] in (0, count - 1)}, points[0]
    second = {p for p in known - ends if rank[p] % 2 == 1}
    away = sorted(abs(p - middle) for p in known)[count // 2]
    near = {p for p in known if 0 < abs(p - middle) <= away}
    far = known - near - {middle}
    expected = [
        (interpolation(spec), {"train": known - second, "test": second}),
        (extrapolation(spec), {"train": known - ends, "test": ends}),
        (distance(spec, [middle], away), {"source": {middle}, "near": near, "far": far}),
        (
            leave_one_out(spec),
            {f"train-{p:g}": known - {p} for p in known} | {f"test-{p:g}": {p} for p in known},
        ),
    ]
    for made, definition in expected:
        episodes = {name: {e for e in episodes_of(spec) if e[0] in p} for name, p in definition.items()}
        assert laters(spec, made) == episodes


def drawn(rng, points, n):
    """A split with random conditions, as in YAML, and its definition."""
    low, high = sorted(rng.integers(n, size=2).tolist())
    few = int(rng.integers(1, n + 1))
    ranges = [
        (None, set(range(n))),
        (few, set(range(few))),
        ({"start": low, "stop": high}, set(range(low, high + 1))),
        ("first 50%", set(range(n // 2))),
        ("last 25%", set(range(n - n // 4, n))),
    ]
    episodes, indices = ranges[rng.integers(len(ranges))]
    chosen = rng.permutation(points)[: rng.integers(len(points) + 1)].tolist()
    label = LABELS[rng.integers(2)] if rng.random() < 0.5 else None
    plain = {"setpoint": chosen or None, "policy": label, "episodes": episodes, "overlap": True}
    labels = LABELS if label is None else (label,)
    return plain, lambda p, own, i: p in (chosen or points) and own in labels and i in indices


@pytest.mark.parametrize("seed", range(8))
def test_splits_that_overlap_equal_their_definitions(seed):
    """Of declared ones, which have files of their own, and of later ones; at any size of a shard."""
    rng, points, n = np.random.default_rng(seed), [10.0, 20.0, 30.0], 8
    made = {f"s{k}": drawn(rng, points, n) for k in range(5)}
    declared = {name: plain for name, (plain, _) in made.items()}
    spec = spec_of(points, n, splits=declared, output={"shard_rows": int(rng.integers(2, 40))})
    every = episodes_of(spec)
    expected = {name: {e for e in every if inside(*e)} for name, (_, inside) in made.items()}
    assert [e for shard in spec.shards for e in every[shard.first : shard.stop]] == every
    in_files = {
        name: {e for shard in spec.shards if name in shard.splits for e in every[shard.first : shard.stop]}
        for name in made
    }
    assert in_files == expected
    later = {name: Split.model_validate(plain) for name, plain in declared.items()}
    assert laters(spec_of(points, n), later) == expected
