"""Finding what there is: lists, suggestions, completion, and help that is not cut."""

import json
from pathlib import Path

import pytest
from helpers.datasets import FOUR_SHARDS
from helpers.folders import run_of

import ibdata

PLAIN = {
    "name": "tiny",
    "setpoints": [20.0, 70.0, 80.0, 90.0],
    "policies": [{"kind": "random"}],
    "episodes": 1,
    "steps": 3,
    "splits": {"low": {"setpoint": 20}},
}


@pytest.fixture
def made(made_at, tmp_path):
    return made_at(PLAIN, tmp_path / "data/tiny")


def test_datasets_of_every_state_are_listed(made, made_at, run, monkeypatch):
    made_at(PLAIN, ".hidden/a")
    (found,) = json.loads(run("ls", "--json")[1])["datasets"]
    assert found == {
        "path": "data/tiny", "state": "finished", "name": "tiny", "rows": 12,
        "setpoints": [20.0, 70.0, 80.0, 90.0], "policies": ["random"],
        "bytes": sum(file["bytes"] for file in made.manifest["files"]), "content_root": made.content_root,
    }  # fmt: skip
    made_at(PLAIN, "damaged")
    Path("damaged/meta/manifest.json").write_text("{}")
    ibdata.generate(FOUR_SHARDS, "x/begun", shards="1/4", workers=1)
    ibdata.generate(FOUR_SHARDS, "x/lost", shards="3/4", workers=1)
    (run_of("x/lost") / "run.json").unlink()
    code, out, _ = run("ls")
    lines = [line.split() for line in out.splitlines()]
    assert code == 0
    assert lines[0] == ["dataset", "rows", "bytes", "setpoints", "policies", "content", "state"]
    assert [(line[0], line[-1]) for line in lines[1:3]] == [
        ("damaged", "unreadable"),
        ("data/tiny", "finished"),
    ]
    assert lines[2][4:9] == ["20", "…", "90", "(4)", "random"]
    assert "unfinished, 1 of 4 shards" in out
    assert "unfinished, unreadable" in out
    for words in (["info", "x/begun"], ["stats", "x/begun"]):
        code, _, err = run(*words)
        assert code == 3
        assert "an unfinished run has 1 of 4 shards here, and the same command goes on" in err
    monkeypatch.setattr("ibdata.dataset.manifest.DATA_VERSION", 99)
    assert run("info", "x/begun")[2].endswith("an unfinished run has 1 of 4 shards here\n")
    assert run("info", "data")[2].endswith("is missing; ibdata ls data lists the datasets in it\n")


def test_a_summary_names_files_that_are_lost(made, run):
    shard = next(made.path.glob("data/*.parquet"))
    shard.unlink()
    shard.symlink_to("nowhere")  # as of git-annex, before the file is fetched
    for command in ("info", "stats"):
        code, out, err = run(command, "data/tiny")
        line = "ibdata: data/tiny: 1 of 2 Parquet files missing; see ibdata validate data/tiny\n"
        assert (code, err, "reward" in out) == (0, line, True)


def test_links_to_datasets_are_followed(made, run):
    Path("linked").mkdir()
    Path("linked/far").symlink_to(made.path)
    Path("linked/up").symlink_to(made.path.parent.parent)
    found = json.loads(run("ls", "linked", "--json")[1])["datasets"]
    assert [each["path"] for each in found] == ["linked/far"]
    Path("empty").mkdir()
    assert run("ls", "empty")[1].startswith("empty: no datasets here or below")


MISSPELT = [
    ("config vaildate", 2, "validate"),
    ("list", 2, "ls"),
    ("report data/tiny", 2, "card"),
    ("info dta/tinny", 3, "data/tiny"),
    ("info data/tiny/data", 3, "data/tiny"),
    ("validate data/tiny/meta/manifest.json", 3, "data/tiny"),
    ("head data/tiny --columns rewrad", 2, "reward"),
    ("stats data/tiny --split lo", 2, "low"),
    ("generate randm.yaml", 2, "random"),
    ("evaluate --policy saef", 2, "safe"),
]


def test_a_misspelt_word_is_answered_with_the_right_one(made, run):
    for line, code, near in MISSPELT:
        found, out, err = run(*line.split())
        assert (found, out) == (code, "")
        assert f"; did you mean {near!r}?" in err


def test_the_shell_completes_names(made, run, monkeypatch):
    monkeypatch.setenv("_IBDATA_COMPLETE", "bash_complete")
    for words, offered in (
        ("generate siemens-offline/gl", "siemens-offline/global-100"),
        ("evaluate saf", "safe"),
        ("repr", "reproduce"),
        ("generate --over", "--overwrite"),
    ):
        monkeypatch.setenv("COMP_WORDS", f"ibdata {words}")
        monkeypatch.setenv("COMP_CWORD", str(len(words.split())))
        _, out, err = run()
        found = [line.partition(",")[2] for line in out.splitlines() if line.startswith("plain,")]
        assert (found, err) == ([offered], "")


def test_an_option_of_the_experiment_is_set_with_set_and_one_of_python_is_named(run):
    code, _, err = run("generate", "random", "--steps", "50")
    assert code == 2
    assert "No such option '--steps'; expected --set steps=…, since" in err
    assert (
        "No such option '--episode'; expected --set episodes=…, since" in run("generate", "--episode", "5")[2]
    )
    assert "--policy" in run("evaluate", "--policies", "safe")[2]

    code, _, err = run("evaluate", "safe", "--view", "3")
    assert code == 2
    assert err.startswith("ibdata: No such option '--view'; it is one of Python's: ibdata.evaluate(…, view=")
