"""Finding what there is: lists, suggestions, completion, and help that is not cut."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment
from ibdata.cli import cli
from ibdata.experiment.shipped import shipped, suites

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


def test_no_summary_of_a_command_is_cut(run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    _, out, _ = run("-h")
    assert "..." not in out.partition("Commands:")[2]
    said = " ".join(out.split())
    for name in cli.list_commands(None):
        summary = " ".join(cli.get_command(None, name).help.split(". ")[0].split("\n\n")[0].split())
        assert summary in said


def test_configs_are_listed_with_rows_and_descriptions(run):
    code, out, _ = run("config", "list")
    lines = out.splitlines()
    assert (code, len(lines)) == (0, 1 + len(suites()) + len(shipped()))
    assert any(line.split()[:3] == ["siemens-offline/", "1,600,000", "A"] for line in lines)
    listed = json.loads(run("config", "list", "--json")[1])["configs"]
    assert {each["name"]: each["rows"] for each in listed}["transfer"] == 20_000


def test_datasets_are_listed_with_totals_of_folders(made, made_at, run):
    assert run("ls", "--json")[1] == json.dumps(
        {
            "version": 1,
            "datasets": [
                {
                    "path": "data/tiny", "state": "finished", "name": "tiny", "rows": 12,
                    "setpoints": [20.0, 70.0, 80.0, 90.0], "policies": ["random"],
                    "bytes": sum(file["bytes"] for file in made.manifest["files"]),
                    "content_root": made.content_root,
                }
            ],
        }
    ) + "\n"  # fmt: skip
    made_at({**PLAIN, "setpoints": 70, "splits": {}}, "data/one")
    code, out, _ = run("ls")
    lines = [line.split() for line in out.splitlines()]
    assert code == 0
    assert lines[0] == ["dataset", "rows", "bytes", "setpoints", "policies", "content", "state"]
    assert lines[1][0::7] == ["data/one", "finished"]
    assert lines[2][4:9] == ["20", "…", "90", "(4)", "random"]
    assert out.splitlines()[3].startswith(".: 2 datasets, 15 rows, ")
    assert run("info", "data")[2].endswith("is missing; ibdata ls data lists the datasets in it\n")
    Path("linked").mkdir()
    Path("linked/far").symlink_to(made.path)
    Path("linked/up").symlink_to(made.path.parent.parent)
    assert [each["path"] for each in json.loads(run("ls", "linked", "--json")[1])["datasets"]] == [
        "linked/far",
        "linked/up/data/one",
    ]
    (made.path / "../empty").mkdir()
    assert run("ls", "data/empty")[1].startswith("data/empty: no datasets here or below")


@pytest.mark.parametrize(
    ("args", "code", "near"),
    [
        (("generat",), 2, "generate"),
        (("config", "vaildate"), 2, "validate"),
        (("info", "dta/tinny"), 3, "data/tiny"),
        (("info", "data/tini"), 3, "data/tiny"),
        (("head", "data/tiny", "--columns", "rewrad"), 2, "reward"),
        (("stats", "data/tiny", "--split", "lo"), 2, "low"),
        (("generate", "randm.yaml"), 2, "random"),
        (("evaluate", "--policy", "saef"), 2, "safe"),
    ],
    ids=str,
)
def test_a_misspelt_word_is_answered_with_the_right_one(made, run, args, code, near):
    found, out, err = run(*args)
    assert (found, out) == (code, "")
    assert f"; did you mean {near!r}?" in err


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (("generate", "siemens-offline/gl"), ["siemens-offline/global-100"]),
        (("generate", "--config", "rand"), ["random", "random-paper"]),
        (("config", "show", "transf"), ["transfer"]),
        (("evaluate", "--policy", "saf"), ["safe"]),
        (("head", "data/tiny", "--columns", "step,rew"), ["step,reward"]),
        (("head", "data/nothing", "--columns", "rew"), []),
        (("head", "data/tiny", "--split", ""), ["low"]),
        (("stats", "data/tiny", "--split", "l"), ["low"]),
        (("split", "data/tiny", "--remove", ""), ["low"]),
        (("export", "data/tiny", "--split", "l"), ["low"]),
        (("evaluate", "saf"), ["safe"]),
        (("repr",), ["reproduce"]),
        (("generate", "--res"), ["--resume"]),
    ],
    ids=str,
)
def test_the_shell_completes_names(made, run, monkeypatch, words, offered):
    monkeypatch.setenv("_IBDATA_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", " ".join(["ibdata", *words]))
    monkeypatch.setenv("COMP_CWORD", str(len(words)))
    _, out, err = run()
    found = [line.partition(",")[2] for line in out.splitlines() if line.startswith("plain,")]
    assert sorted(found) == offered
    assert err == ""


def test_diff_tells_other_content_from_no_dataset(made, run):
    ibdata.generate(Experiment.model_validate({**PLAIN, "seed": 1}), "other", workers=1)
    assert run("diff", "data/tiny", "data/tiny")[0] == 0
    assert run("diff", "data/tiny", "other")[0] == 3
    assert run("diff", "data/tiny", "nothing")[0] == 2
    assert run("diff", "nothing", "other")[0] == 2
    (made.path / "meta/manifest.json").write_text("{}")
    assert run("diff", "data/tiny", "other")[0] == 3


def test_a_dry_run_beside_its_dataset_ends_well(run):
    tiny = ("random.yaml", "--set", "steps=1", "--set", "setpoints=70")
    code, out, _ = run("generate", *tiny)
    assert "1 in 1 episode of 1 step\n" in out
    code, out, _ = run("generate", *tiny, "--dry-run")
    assert code == 0
    assert "folder    exists; generate would find the dataset finished, and write nothing\n" in out
    assert "with 1 worker (" in out
    assert "1 row," in run("config", "validate", *tiny)[1].replace("row\n", "row,")


@pytest.mark.parametrize("given", [(), ("config",)], ids=["ibdata", "config"])
def test_a_group_without_a_command_prints_its_help_line_by_line(run, given):
    code, out, err = run(*given)
    assert (code, out) == (2, "")
    assert err == run(*given, "-h")[1]


def test_an_option_of_the_experiment_is_set_with_set(run):
    code, _, err = run("generate", "random", "--steps", "50")
    assert code == 2
    assert "No such option '--steps'; expected --set steps=…, since" in err
    assert "Did you mean" in run("evaluate", "--policies", "safe")[2]
