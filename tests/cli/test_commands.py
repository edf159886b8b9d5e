"""What commands print, as text and as JSON."""

import json
import shutil
from pathlib import Path

import pytest

import ibdata

TINY = ("--set", "steps=3", "--workers", "1")


@pytest.fixture(scope="module")
def transfer(tmp_path_factory):
    folder = tmp_path_factory.mktemp("commands") / "made"
    return ibdata.generate("transfer", folder, overrides=["steps=30"], workers=1).path


@pytest.fixture
def data(transfer, run, tmp_path):
    return shutil.copytree(transfer, tmp_path / "data/made").relative_to(tmp_path)


REPORTS = ["info DATA", "head DATA", "stats DATA", "config validate random", "config show random"]


def test_what_config_shows_can_be_generated(run):
    for form in ([], ["--json"]):
        Path("shown.yaml").write_text(run("config", "show", "random", "--set", "steps=3", *form)[1])
        assert ibdata.load("shown.yaml") == ibdata.load("random", ["steps=3"])


def test_every_report_is_text_or_one_json_document(run, data):
    for line in REPORTS:
        args = line.replace("DATA", str(data)).split()
        code, out, err = run(*args)
        assert (code, bool(out.strip()), err) == (0, True, "")
        code, out, err = run(*args, "--json")
        assert (code, json.loads(out)["version"], err) == (0, 1, "")


def test_info_names_counts_splits_and_the_content_root(run, data):
    text, document = run("info", str(data))[1], json.loads(run("info", str(data), "--json")[1])
    assert "600 in 20 episodes of 30 steps" in text
    assert "split target 60 rows in 2 episodes" in " ".join(text.split())
    assert document["content_root"] in text
    assert document["info"]["counts"]["rows"] == 600


def test_head_prints_the_columns_and_split_asked_for(run, data):
    args = ("head", str(data), "-n", "2", "--columns", "step,obs_setpoint", "--split", "target")
    rows = [{"step": 0, "obs_setpoint": 75.0}, {"step": 1, "obs_setpoint": 75.0}]
    assert json.loads(run(*args, "--json")[1])["rows"] == rows
    assert run(*args)[1].split() == ["step", "0", "1", "obs_setpoint", "75", "75"]


def test_a_dataset_that_is_not_there_is_exit_code_3(run):
    for line, message in (
        ("info safe", "; ibdata generate --config safe makes data/safe"),
        (
            "stats data/neorl-like",
            "; ibdata generate --config neorl-like makes the datasets of data/neorl-like",
        ),
        ("stats d4rl-like/medium", "; ibdata generate --config d4rl-like/medium makes data/d4rl-like/"),
        ("info nowhere --debug", "Traceback"),
    ):
        code, out, err = run(*line.split())
        assert (code, out, message in err) == (3, "", True)


def test_generate_prints_the_dataset_on_stdout_only(run):
    ibdata.generate("random", "compiled", overrides=["steps=3"], workers=1)  # which says so, the first time
    code, out, err = run("generate", "random", *TINY)
    assert (code, out.startswith("dataset "), err) == (0, True, "")
    data = json.loads(run("generate", "random", *TINY, "--out", "here", "--json")[1])
    assert [data[name] for name in ("version", "out", "rows", "episodes", "shards")] == [1, "here", 30, 10, 1]
    assert data["content_root"] in out


def test_a_dry_run_says_what_would_be_made_and_writes_nothing(run, tmp_path):
    data = json.loads(run("generate", "transfer", "--dry-run", "--json")[1])
    assert [data[name] for name in ("episodes", "rows", "shards")] == [20, 20_000, 3]
    assert data["bytes"] > 0
    shown = run("generate", "transfer", "--dry-run")[1]
    assert shown.startswith("out       data/transfer (nothing is written)\n")
    assert "shards    3" in shown
    assert list(tmp_path.iterdir()) == []


def test_every_error_of_an_experiment_is_shown_up_to_twelve(run, tmp_path):
    lines = "".join(f"wrong_{i}: 1\n" for i in range(15))
    (tmp_path / "bad.yaml").write_text(f"name: bad\nsetpoints: [50]\npolicies: [{{kind: random}}]\n{lines}")
    code, out, err = run("generate", "bad.yaml", "--json")
    error, shown = json.loads(out)["error"], err.splitlines()
    assert (code, error["code"], error["file"], error["line"]) == (2, 2, "bad.yaml", 4)
    assert (len(shown), shown[12]) == (13, "ibdata: and 3 more")
    assert shown[0].startswith("bad.yaml:4:1: wrong_0: no such option")


def test_a_suite_is_made_in_a_folder_of_its_name(run, tmp_path):
    tiny = ("generate", "neorl-like", "--set", "episodes=1", *TINY)
    guessed = json.loads(run(*tiny, "--dry-run", "--json")[1])
    assert "data/neorl-like/high: 3 rows, " in run(*tiny, "--dry-run")[1]
    assert not (tmp_path / "data").exists()
    data = json.loads(run(*tiny, "--json")[1])
    assert (data["out"], data["rows"], len(data["datasets"])) == ("data/neorl-like", 9, 3)
    assert [guessed[name] for name in ("out", "rows")] == [data["out"], data["rows"]]
    code, out, _ = run(*tiny)
    assert (code, "3 in data/neorl-like" in out) == (0, True)
    assert data["datasets"][0]["content_root"] in out


FEW = ("--episodes", "5", "--steps", "20")
COLUMNS = [
    "policy", "setpoint", "episodes", "mean_return", "standard_error", "interval", "p10", "mean_reward",
    "score", "score_error", "expert_score", "clipped", "mean_cost", "cost_error", "violations",
]  # fmt: skip
HIDDEN = ("interval", "clipped", "expert_score", "mean_cost", "cost_error", "violations")  # in tables


def test_evaluate_prints_results_differences_and_the_scale(run):
    greedy = "{kind: epsilon_greedy, base: {kind: bad}, epsilon: 0.5}"
    places = ("--setpoint", "70", "--setpoint", "50.0000001", "--setpoint", "50.0000002")
    code, out, err = run("evaluate", "optimized", "--policy", greedy, *places, *FEW, "--json")
    data = json.loads(out)
    assert (code, err, data["version"]) == (0, "", 1)
    setpoints = [70.0, 50.0000001, 50.0000002, None]
    assert [(r["policy"], r["setpoint"]) for r in data["results"]] == [
        (policy, p) for policy in ("optimized", "epsilon_greedy") for p in setpoints
    ]
    assert set(data["results"][0]) == set(COLUMNS)
    assert [d["setpoint"] for d in data["differences"]] == setpoints
    assert "100 = optimized" in data["scale"]
    lines = run("evaluate", "optimized", *places, *FEW)[1].splitlines()
    assert set(lines[0].split()) < set(COLUMNS) - set(HIDDEN)  # what 80 columns have room for
    assert max(map(len, lines[:5])) <= 80
    wide = run("evaluate", "optimized", *places, *FEW, "--wide")[1].splitlines()
    assert wide[0].split() == [name for name in COLUMNS if name not in HIDDEN[3:]]
    assert [line.split()[1] for line in lines[1:5]] == ["70.0000000", "50.0000001", "50.0000002", "all"]


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
    few = ("split", "d", "--by", "transfer", "source=50", "target=70")
    assert run(*few, "shots=1") == (
        0,
        "low          12 rows in 4 episodes (whole files)\n"
        "source       12 rows in 4 episodes (labels)\n"
        "target       6 rows in 2 episodes (labels)\n"
        "target-rest  6 rows in 2 episodes (labels)\n",
        "",
    )
    ibdata.split("d", {"random": {"policy": "random"}, "careful": {"policy": "safe"}})
    assert run(*few, "--remove", "random")[1].splitlines()[:3] == [
        "removed the split target-rest",
        "removed the split random",
        "replaced the split target; another name keeps both",
    ]
    taken = json.loads(run("split", "d", "--remove", "careful", "--json")[1])["taken_away"]
    assert taken == {"removed": ["careful"]}


def test_the_list_changes_nothing_and_takes_no_other_option(made, run):
    before = ibdata.open("d").stored.splits
    assert run("split", "d", "--list")[:2] == (0, "low  12 rows in 4 episodes (whole files)\n")
    code, out, err = run("split", "d", "--list", "a.setpoint=50")
    assert (code, out) == (2, "")
    assert "--list changes nothing, but found more" in err
    assert ibdata.open("d").stored.splits == before
    assert "expected NAME=SPLIT, in quotes such as 'calm={" in run("split", "d", "x")[2]


WRITING = """
generate --config transfer
generate --config transfer --out ../named/a
split ../named/a calm.setpoint=50
card ../named/a
export ../named/a --to npz --out ../named/a.npz
evaluate safe --setpoint 70 --episodes 2 --steps 3 --save ../named/table.json
init ../named/mine.yaml
"""


def test_commands_write_into_the_places_that_are_named_and_nowhere_else(run, tmp_path, monkeypatch):
    """The cache apart; without --out, a dataset goes to data/NAME."""
    for name in ("here", "named"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for line in WRITING.split("\n")[1:-1]:
        assert run(*line.split(), *(TINY if line.startswith("generate") else ()))[0] == 0, line
    assert sorted(str(path.relative_to(tmp_path)) for path in tmp_path.glob("*/*")) == [
        "here/data",
        *(f"named/{name}" for name in ("a", "a.npz", "mine.yaml", "table.json")),
    ]
    assert [path.name for path in Path("data").iterdir()] == ["transfer"]
