"""Splits equal their definitions, written as sets of episodes: schemes, and ranges that overlap."""

from dataclasses import replace

import numpy as np
import pytest

from ibdata.experiment import Experiment
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fields import Split
from ibdata.experiment.split_schemes import distance, extrapolation, interpolation, leave_one_out

LABELS = ("random", "safe")


def spec_of(setpoints, episodes=2, **more):
    plain = {"name": "x", "setpoints": setpoints, "policies": LABELS, "steps": 2, "episodes": episodes}
    return DatasetSpec.of(Experiment.model_validate({**plain, **more}))


def episodes_of(spec):
    """The setpoint, the label and the index in its cell of each episode, in the order of a dataset."""
    (experiment,) = spec.experiments
    return [(cell.setpoint, cell.label, i) for cell in experiment.cells for i in range(experiment.episodes)]


def members(spec, splits):
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
        assert members(spec, made) == episodes


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
    assert members(spec_of(points, n), later) == expected
