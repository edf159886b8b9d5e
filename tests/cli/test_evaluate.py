"""`ibdata evaluate` as a user runs it."""

from __future__ import annotations

import json

import pytest

pytestmark = pytest.mark.slow

FEW = ("--episodes", "5", "--steps", "100")


def test_json_holds_results_differences_and_the_scale(ibdata):
    policies = (
        "--policy",
        "optimized",
        "--policy",
        "{kind: epsilon_greedy, base: {kind: bad}, epsilon: 0.5}",
    )
    done = ibdata("evaluate", *policies, "--setpoint", "70", "--setpoint", "50", *FEW, "--json")
    data = json.loads(done.stdout)
    assert data["version"] == 1
    places = [(r["policy"], r["setpoint"]) for r in data["results"]]
    assert places == [(policy, p) for policy in ("optimized", "epsilon_greedy") for p in (70.0, 50.0, None)]
    first = data["results"][0]
    assert set(first) == {
        "policy", "setpoint", "episodes", "mean_return", "standard_error", "interval", "p10", "mean_reward",
        "score", "score_error", "expert_score", "clipped",
    }  # fmt: skip
    assert -7000 < first["interval"][0] < first["mean_return"] < first["interval"][1] < -5000
    assert [d["setpoint"] for d in data["differences"]] == [70.0, 50.0, None]
    assert "100 = optimized" in data["scale"]
    assert done.stderr == ""


def test_people_get_a_table(ibdata):
    lines = ibdata("evaluate", "safe", "random", *FEW).stdout.splitlines()
    assert lines[0].split() == [
        "policy", "setpoint", "episodes", "mean_return", "standard_error", "p10", "mean_reward", "score",
        "score_error", "expert_score",
    ]  # fmt: skip
    assert max(map(len, lines)) <= 120
    assert [line.split()[0] for line in lines[1:4]] == ["safe", "random", "score:"]
    assert lines[5].split()[:3] == ["policy", "less", "setpoint"]
    assert lines[6].split()[:3] == ["random", "safe", "70"]
    assert len(lines) == 7
    single = ibdata("evaluate", "--policy", "safe", "--episodes", "1", "--steps", "5").stdout.splitlines()
    assert single[1].split()[4] == "–"
    assert [line.partition(":")[0] for line in single[2:]] == ["score", "no standard error"]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("--policy", "optimised"), "did you mean 'optimized'?"),
        (
            ("--policy", "safe", "--setpoint", "101"),
            "setpoint: found 101, expected a number of at most 100",
        ),
        (("--policy", "safe", "--start", "[1"), "--start [1: not valid YAML"),
        (("--policy", "safe", "--discount", "2"), "discount: found 2.0, expected a number in [0, 1]"),
        ((), "Missing argument 'POLICY'"),
    ],
    ids=str,
)
def test_a_call_that_cannot_be_meant_exits_2_with_a_line(ibdata, args, message):
    done = ibdata("evaluate", *args)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stdout == ""


def test_close_setpoints_are_told_apart(ibdata):
    close = ("--setpoint", "50.0000001", "--setpoint", "50.0000002")
    lines = ibdata("evaluate", "--policy", "safe", *close, *FEW).stdout.splitlines()
    assert [line.split()[1] for line in lines[1:4]] == ["50.0000001", "50.0000002", "all"]


def test_the_baselines_of_a_set_have_a_line_an_algorithm(ibdata):
    lines = ibdata("evaluate", "optimized", "--against", "optimized-0").stdout.splitlines()
    assert lines[1].split()[:3] == ["optimized", "70", "200"]
    assert [line.split()[1] for line in lines[5:]] == [
        "behaviour",
        "bc",
        "td3+bc",
        "iql",
        "cql",
        "model-based",
    ]
    behaviour = lines[5].split()
    assert behaviour[2:4] == ["1", "-5,971.18"]
    assert abs(float(behaviour[7])) < 1e-3
