"""Which episodes go into which file."""

from __future__ import annotations

from itertools import pairwise

from helpers import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.experiment import Experiment
from ibdata.plan.dataset_spec import DatasetSpec

POLICIES = [{"kind": "random"}, {"kind": "safe"}, {"kind": "constant", "name": "still"}]
LABELS = ["random", "safe", "still"]


@st.composite
def experiments(draw):
    setpoints = draw(st.lists(st.sampled_from([10.0, 50.0, 75.0]), min_size=1, max_size=3, unique=True))
    labels = LABELS[: draw(st.integers(1, 3))]
    episodes = draw(st.integers(1, 9))

    def some_episodes():
        start, stop = sorted(draw(st.tuples(*[st.integers(0, episodes - 1)] * 2)))
        shares = ["first 50%", "last 25%"] if episodes > 1 else []
        return draw(st.sampled_from([stop + 1, {"start": start, "stop": stop}, *shares]))

    def split():
        block = {"overlap": True}
        if draw(st.booleans()):
            block["setpoint"] = draw(st.lists(st.sampled_from(setpoints), min_size=1, unique=True))
        if draw(st.booleans()):
            block["policy"] = draw(st.sampled_from(labels))
        if draw(st.booleans()):
            block["episodes"] = some_episodes()
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


def held(n, block):
    """The episodes of n that a split names."""
    named = block.get("episodes", n)
    if isinstance(named, dict):
        return range(named["start"], named["stop"] + 1)
    return {"first 50%": range(n // 2), "last 25%": range(3 * n // 4, n)}.get(named) or range(named)


def splits_of(made, episode):
    """The splits of an episode, from the words of the config."""
    cell, index = divmod(episode, made.episodes)
    policy, setpoint = divmod(cell, len(made.setpoints))
    found = []
    for name, block in made.plain()["splits"].items():
        if (
            made.setpoints[setpoint] in block.get("setpoint", made.setpoints)
            and block.get("policy", LABELS[policy]) == LABELS[policy]
            and index in held(made.episodes, block)
        ):
            found.append(name)
    return tuple(found)


@tries(300)
@given(experiments())
def test_a_plan_holds_every_episode_once_in_full_shards(made):
    """A shard ends only where it is full or the splits change."""
    shards = DatasetSpec.of(made).shards
    episodes = [episode for shard in shards for episode in range(shard.first, shard.stop)]
    assert episodes == list(range(made.rows // made.steps))
    assert [shard.stem for shard in shards] == [f"data/part-{i:05d}" for i in range(len(shards))]
    for shard, following in pairwise([*shards, None]):
        count, rows = shard.stop - shard.first, made.output.shard_rows
        assert count == 1 or count * made.steps <= rows
        assert {splits_of(made, episode) for episode in range(shard.first, shard.stop)} == {shard.splits}
        assert not following or (count + 1) * made.steps > rows or shard.splits != following.splits


@tries(300)
@given(experiments())
def test_the_runs_of_later_splits_are_those_of_each_episode(made):
    """Of two experiments, as a merged dataset has them."""
    declared = Experiment.model_validate({**made.plain(), "splits": {}})
    count = len(declared.cells) * declared.episodes
    for name, runs in DatasetSpec("x", (declared, declared), made.splits).later_runs().items():
        inside = [episode for first, stop, _ in runs for episode in range(first, stop)]
        assert inside == [e for e in range(2 * count) if name in splits_of(made, e % count)]
        assert all(stop < first for (_, stop, _), (first, *_) in pairwise(runs))
