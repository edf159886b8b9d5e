"""Making episodes again, and comparing datasets."""

import pytest
from helpers.forging import seal
from helpers.tiny import PLAIN

import ibdata
from ibdata.errors import UsageError


@pytest.mark.parametrize(("episodes", "count"), [(None, 12), ("5", 5), ("3-7", 5), ("100", 12)])
def test_a_dataset_is_reproduced_whole_or_in_part(made, episodes, count):
    assert ibdata.reproduce(made.path, episodes) == (count, [])


@pytest.mark.parametrize("episodes", ["-3", "7-3", "٣"])
def test_episodes_that_are_none_are_refused(made, episodes):
    with pytest.raises(UsageError, match=r"^--episodes: found "):
        ibdata.reproduce(made.path, episodes)


def test_an_episode_that_is_not_reproduced_is_named(copied, file):
    seal(copied, lambda listed: listed["experiments"][0].update(seed=1))
    count, problems = ibdata.reproduce(copied, "4-5")
    assert count == 2
    assert [(p.path, p.row, p.message) for p in problems] == [
        (file("shard 2"), 20, "episode 4: found other content when made again"),
        (file("shard 3"), 0, "episode 5: found other content when made again"),
    ]


@pytest.mark.parametrize("damage", [lambda path: path.write_bytes(b"garbage"), lambda path: path.unlink()])
def test_reproduce_names_a_changed_or_missing_file(copied, file, damage):
    path = file("shard 1")
    first = ibdata.open(copied).manifest["shards"][1]["episodes"][0]
    damage(copied / path)
    count, problems = ibdata.reproduce(copied)
    assert (count, [problem.path for problem in problems]) == (12, [path])
    assert ibdata.reproduce(copied, f"{first - 1}-{first - 1}") == (1, [])
    assert len(ibdata.reproduce(copied, f"{first}-{first}")[1]) == 1


@pytest.mark.parametrize(
    ("change", "lines"),
    [
        ({"output": {"shard_rows": 1000}}, []),
        ({"seed": 1}, ["experiment.seed: 0 and 1", "episode 0 and 0: step 0: "]),
        (
            {"episodes": 4},
            ["episodes: 12 and 16", "episodes with a cell and index that only the second has: 4"],
        ),
        ({"output": {"dtype": "float64"}}, ["column reward: float32 and float64"]),
    ],
    ids=str,
)
def test_a_difference_is_named(made, made_at, tmp_path, change, lines):
    found = ibdata.difference(made, made_at({**PLAIN, **change}, tmp_path / "other"))
    assert bool(found) == bool(lines)
    for line in lines:
        assert any(each.startswith(line) for each in found), found
