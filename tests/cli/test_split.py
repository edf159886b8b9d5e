"""`ibdata split` says what it makes, replaces and removes."""

import json

import pytest

import ibdata

PLAIN = {
    "name": "tiny",
    "setpoints": [20.0, 50.0, 70.0],
    "policies": [{"kind": "random"}, {"kind": "safe"}],
    "episodes": 2,
    "steps": 3,
    "splits": {"low": {"setpoint": 20}},
}


@pytest.fixture
def made(made_at, tmp_path):
    made_at(PLAIN, tmp_path / "d")


def test_what_is_replaced_or_removed_is_said(made, run):
    few = ("split", "d", "--by", "setpoint", "--source", "50", "--target", "70", "--prefix", "few")
    assert run(*few, "--shots", "1") == (
        0,
        "low              12 rows in 4 episodes (whole files)\n"
        "few-source       12 rows in 4 episodes (labels)\n"
        "few-target       6 rows in 2 episodes (labels)\n"
        "few-target-rest  6 rows in 2 episodes (labels)\n",
        "",
    )
    ibdata.split("d", by="policy", names={"safe": "careful"})
    assert run(*few, "--remove", "random")[1].splitlines()[:3] == [
        "removed the split few-target-rest",
        "removed the split random",
        "replaced the split few-target; --prefix or --name keeps both",
    ]
    taken = json.loads(run("split", "d", "--remove", "careful", "--json")[1])["taken_away"]
    assert taken == {"removed": ["careful"]}


def test_the_list_changes_nothing_and_takes_no_other_option(made, run):
    before = ibdata.open("d").stored.splits
    assert run("split", "d", "--list")[:2] == (0, "low  12 rows in 4 episodes (whole files)\n")
    code, out, err = run("split", "d", "--list", "--shots", "1")
    assert (code, out) == (2, "")
    assert "--list changes nothing, but found --shots too" in err
    assert ibdata.open("d").stored.splits == before
    assert "expected two names such as source=at-50" in run("split", "d", "--by", "policy", "--name", "x")[2]
