"""Which episodes go into which file."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ibdata.experiment import Experiment
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.plan import plan, segments
from ibdata.experiment.split_schemes import leave_one_out

examples = settings(derandomize=True, deadline=None, max_examples=300)

POLICIES = [{"kind": "random"}, {"kind": "safe"}, {"kind": "constant", "name": "still"}]
LABELS = ["random", "safe", "still"]


def experiment(**fields):
    return Experiment(**{"name": "x", "setpoints": 70, "policies": POLICIES[:1], "episodes": 10, **fields})


def ranges(**fields):
    """(first, stop, splits) of the shards."""
    return [(shard.first, shard.stop, shard.splits) for shard in plan(experiment(**fields))]


@st.composite
def experiments(draw):
    setpoints = draw(st.lists(st.sampled_from([10.0, 50.0, 75.0]), min_size=1, max_size=3, unique=True))
    labels = LABELS[: draw(st.integers(1, 3))]
    episodes = draw(st.integers(1, 9))

    def episode_range():
        start = draw(st.integers(0, episodes - 1))
        return {"start": start, "stop": draw(st.integers(start, episodes - 1))}

    def split():
        block = {"overlap": True}
        if draw(st.booleans()):
            block["setpoint"] = draw(st.lists(st.sampled_from(setpoints), min_size=1, unique=True))
        if draw(st.booleans()):
            block["policy"] = draw(st.sampled_from(labels))
        if draw(st.booleans()):
            block["episodes"] = episode_range()
        return block

    return Experiment(
        name="x",
        setpoints=setpoints,
        policies=POLICIES[: len(labels)],
        episodes=episodes,
        steps=draw(st.integers(1, 30)),
        output={"shard_rows": draw(st.integers(1, 200))},
        splits={f"s{i}": split() for i in range(draw(st.integers(0, 3)))},
    )


def splits_of(made, episode):
    """The splits of an episode, from the words of the config."""
    cell, index = divmod(episode, made.episodes)
    policy, setpoint = divmod(cell, len(made.setpoints))
    found = []
    for name, block in made.plain()["splits"].items():
        bounds = block.get("episodes", {"start": 0, "stop": made.episodes - 1})
        if (
            made.setpoints[setpoint] in block.get("setpoint", made.setpoints)
            and block.get("policy", LABELS[policy]) == LABELS[policy]
            and bounds["start"] <= index <= bounds["stop"]
        ):
            found.append(name)
    return tuple(found)


@examples
@given(experiments())
def test_every_episode_is_in_one_shard_and_in_order(made):
    shards = plan(made)
    episodes = [episode for shard in shards for episode in range(shard.first, shard.stop)]
    assert episodes == list(range(made.rows // made.steps))
    assert [shard.number for shard in shards] == list(range(len(shards)))
    assert all(shard.first < shard.stop for shard in shards)


@examples
@given(experiments())
def test_no_shard_has_more_rows_than_asked_for_unless_it_is_one_episode(made):
    for shard in plan(made):
        count = shard.stop - shard.first
        assert count == 1 or count * made.steps <= made.output.shard_rows


@examples
@given(experiments())
def test_the_splits_of_a_shard_are_those_of_each_of_its_episodes(made):
    for shard in plan(made):
        assert {splits_of(made, episode) for episode in range(shard.first, shard.stop)} == {shard.splits}


@examples
@given(experiments())
def test_a_shard_ends_only_where_it_is_full_or_the_splits_change(made):
    shards = plan(made)
    for shard, following in pairwise(shards):
        full = (shard.stop - shard.first + 1) * made.steps > made.output.shard_rows
        assert full or shard.splits != following.splits


@examples
@given(experiments())
def test_the_plan_is_the_same_every_time(made):
    assert plan(made) == plan(Experiment.model_validate(made.plain()))


def test_a_small_experiment_is_one_shard_over_all_its_cells():
    assert ranges(setpoints=[10, 20], policies=POLICIES[:2], steps=5) == [(0, 40, ())]


def test_shards_hold_whole_episodes_and_the_last_one_what_is_left():
    # 7 rows an episode, 23 a shard: three episodes.
    assert ranges(steps=7, output={"shard_rows": 23}) == [(0, 3, ()), (3, 6, ()), (6, 9, ()), (9, 10, ())]


def test_a_shard_may_be_filled_to_the_row():
    assert ranges(steps=5, output={"shard_rows": 25}) == [(0, 5, ()), (5, 10, ())]


def test_an_episode_that_is_longer_than_a_shard_has_one_of_its_own():
    assert ranges(episodes=3, steps=100, output={"shard_rows": 99}) == [(i, i + 1, ()) for i in range(3)]


def test_a_shard_is_cut_where_a_split_begins_and_where_it_ends():
    splits = {"middle": {"episodes": {"start": 3, "stop": 5}}}
    assert ranges(splits=splits) == [(0, 3, ()), (3, 6, ("middle",)), (6, 10, ())]


def test_splits_of_single_cells_run_over_the_bounds_of_cells_that_share_them():
    # Two policies at three setpoints: cells 0 … 5 of two episodes each.
    splits = {"source": {"setpoint": [20, 30]}, "target": {"setpoint": 10, "episodes": 1}}
    assert ranges(setpoints=[10, 20, 30], policies=POLICIES[:2], episodes=2, splits=splits) == [
        (0, 1, ("target",)),
        (1, 2, ()),
        (2, 6, ("source",)),
        (6, 7, ("target",)),
        (7, 8, ()),
        (8, 12, ("source",)),
    ]


def test_overlapping_splits_cut_wherever_one_of_them_does():
    splits = {
        "early": {"episodes": 6},
        "late": {"episodes": {"start": 4, "stop": 9}, "overlap": True},
    }
    assert ranges(splits=splits) == [(0, 4, ("early",)), (4, 6, ("early", "late")), (6, 10, ("late",))]


def test_splits_are_filled_anew_after_a_cut():
    splits = {"late": {"episodes": {"start": 5, "stop": 9}}}
    cut = ranges(steps=1, output={"shard_rows": 3}, splits=splits)
    assert cut == [(0, 3, ()), (3, 5, ()), (5, 8, ("late",)), (8, 10, ("late",))]


def test_leave_one_out_has_a_run_for_every_setpoint():
    made = experiment(setpoints=[float(p) for p in range(60)], episodes=2)
    runs = segments(made, leave_one_out(DatasetSpec.of(made)))
    assert [stop - first for first, stop, _ in runs] == [2] * 60
    for p, (_, _, names) in enumerate(runs):
        assert set(names) == {f"test-{p}", *(f"train-{q}" for q in range(60) if q != p)}


@examples
@given(experiments())
def test_the_runs_of_later_splits_are_those_of_each_episode(made):
    """Of two experiments, as a merged dataset has them."""
    declared = Experiment.model_validate({**made.plain(), "splits": {}})
    count = len(declared.cells) * declared.episodes
    for name, runs in DatasetSpec("x", (declared, declared), made.splits).later_runs().items():
        inside = [episode for first, stop, _ in runs for episode in range(first, stop)]
        assert inside == [e for e in range(2 * count) if name in splits_of(made, e % count)]
        assert all(a.stop < b.first for a, b in pairwise(runs))


@pytest.mark.parametrize(("number", "file"), [(0, "part-00000"), (12, "part-00012"), (99_999, "part-99999")])
def test_a_shard_has_its_number_in_its_files_name(number, file):
    shards = plan(experiment(episodes=100_000, steps=1, output={"shard_rows": 1}))
    assert shards[number].stem == f"data/{file}"
