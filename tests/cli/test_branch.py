"""`ibdata branch` as a user runs it."""

from __future__ import annotations

import json

import pytest

from ibdata import true_values

pytestmark = pytest.mark.slow

FEW = ("--episodes", "5", "--steps", "10")


def test_json_is_the_library_call(ibdata, dataset):
    options = (
        "--policy",
        "safe",
        "--at",
        "3:20",
        "--at",
        "11:0",
        "--action",
        "0",
        "0.5",
        "-1",
        "--seed",
        "4",
    )
    done = ibdata("branch", str(dataset.path), *options, *FEW, "--discount", "0.5", "--json")
    rows, actions = {"episode": [3, 11], "step": [20, 0]}, [[0, 0.5, -1]] * 2
    found = true_values(dataset, rows, "safe", actions, steps=10, episodes=5, discount=0.5, seed=4)
    assert json.loads(done.stdout) == {"version": 1, **json.loads(json.dumps(found.plain()))}
    assert done.stderr == ""


def test_people_get_a_table(ibdata, dataset):
    lines = ibdata("branch", str(dataset.path), "--policy", "safe", "--at", "3:20", *FEW).stdout.splitlines()
    assert lines[0].split() == ["episode", "step", "value", "±", "s.e.", "95", "%", "interval"]
    assert lines[1].split()[:2] == ["3", "20"]
    assert len(lines) == 2
    single = ("--episodes", "1", "--steps", "5")
    single = ibdata("branch", str(dataset.path), "--policy", "safe", "--at", "3:20", *single).stdout
    assert single.splitlines()[1].split()[3:] == ["-", "-"]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("--policy", "safe", "--at", "3"), "--at: found '3', expected EPISODE:STEP, such as 3:500"),
        (("--policy", "safe", "--at", "12:0"), "episode: found 12, expected one of 0 to 11"),
        (("--policy", "optimised", "--at", "3:0"), "did you mean 'optimized'?"),
        (("--policy", "safe"), "Missing option '--at'"),
    ],
    ids=str,
)
def test_a_call_that_cannot_be_meant_exits_2_with_a_line(ibdata, dataset, args, message):
    done = ibdata("branch", str(dataset.path), *args)
    assert (done.returncode, done.stdout) == (2, "")
    assert message in done.stderr
