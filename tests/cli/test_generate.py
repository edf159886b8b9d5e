"""`ibdata generate` as a user runs it."""

from __future__ import annotations

import json

import pyarrow.parquet as pq
import pytest

pytestmark = pytest.mark.slow

SMALL = ("--set", "steps=20")


def test_the_papers_batch_comes_out_in_an_empty_folder(ibdata, tmp_path):
    done = ibdata("generate", "--config", "random.yaml")
    assert done.returncode == 0
    assert "10,000 in 10 episodes of 1,000 steps" in done.stdout
    assert pq.read_table(tmp_path / "data/random/data").num_rows == 10_000


def test_stdout_holds_the_result_and_stderr_nothing(ibdata):
    ibdata("generate", "--config", "random", *SMALL)  # compiles where nothing is compiled yet
    done = ibdata("generate", "--config", "random", *SMALL, "--overwrite")
    assert done.stdout.startswith("dataset ")
    assert done.stderr == ""


def test_json_is_one_document_with_a_version(ibdata):
    done = ibdata("generate", "--config", "random", *SMALL, "--out", "here", "--json")
    data = json.loads(done.stdout)
    assert data["version"] == 1
    assert (data["out"], data["rows"], data["episodes"], data["shards"]) == ("here", 200, 10, 1)
    assert len(data["content_root"]) == 64


@pytest.mark.parametrize("overwrite", [(), ("--overwrite",)])
def test_a_folder_of_somebody_is_refused_and_kept(ibdata, tmp_path, overwrite):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes.txt").write_text("keep me")
    done = ibdata("generate", "--config", "random", *SMALL, "--out", "mine", *overwrite)
    assert done.returncode == 2
    assert (
        done.stderr == "mine: not a dataset of ibdata, left as it is; move it away, or choose another --out\n"
    )
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["notes.txt"]
    assert list(tmp_path.iterdir()) == [tmp_path / "mine"]


def test_overwrite_replaces_a_dataset_but_no_file_of_somebody(ibdata, tmp_path):
    ibdata("generate", "--config", "random", *SMALL)
    notes = tmp_path / "data/random/notes.txt"
    notes.write_text("keep me")
    other = ("generate", "--config", "random", *SMALL, "--seed", "1", "--overwrite")
    done = ibdata(*other)
    message = "data/random/notes.txt: found a file that is not the dataset's; move it away\n"
    assert (done.returncode, done.stderr.removeprefix(f"{tmp_path}/")) == (2, message)
    assert notes.read_text() == "keep me"
    notes.unlink()
    assert ibdata(*other).returncode == 0
    assert "seed: 1" in (tmp_path / "data/random/meta/experiment.yaml").read_text()


def test_a_dry_run_says_what_would_be_made_and_writes_nothing(ibdata, tmp_path):
    done = ibdata("generate", "--config", "transfer", "--dry-run", "--json")
    data = json.loads(done.stdout)
    assert (data["episodes"], data["rows"], data["shards"]) == (20, 20_000, 3)
    assert data["bytes"] > 0
    assert data["seconds"] > 0
    shown = ibdata("generate", "--config", "transfer", "--dry-run").stdout
    assert shown.startswith("out       data/transfer (nothing is written)\n")
    assert "shards    3" in shown
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("--config", "ranom"), "did you mean 'random'?"),
        (
            ("--config", "random", "--set", "step=3"),
            "override step: no such option; did you mean 'steps'?",
        ),
        (("--config", "random", "--seed", "-1"), "seed: found -1, expected a whole number of at least 0"),
        (("--config", "random", "--workers", "0"), "workers: found 0, expected a whole number in [1, 1024]"),
        (("--config", "random", "--out", "file"), "file: is a file, not a folder"),
        ((), "Missing argument 'CONFIG'; ibdata config list lists"),
        (("random", "--config", "safe"), "found CONFIG 'random' and --config 'safe', expected one of them"),
        (("--config", "random", "--nonsense"), "No such option"),
    ],
)
def test_a_wrong_call_exits_2_with_a_line_and_leaves_nothing(ibdata, tmp_path, args, message):
    (tmp_path / "file").touch()
    done = ibdata("generate", *args)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_every_error_of_an_experiment_is_shown_up_to_twelve(ibdata, tmp_path):
    lines = "".join(f"wrong_{i}: 1\n" for i in range(15))
    (tmp_path / "bad.yaml").write_text(f"name: bad\nsetpoints: [50]\npolicies: [{{kind: random}}]\n{lines}")
    done = ibdata("generate", "--config", "bad.yaml")
    shown = done.stderr.splitlines()
    assert len(shown) == 13
    assert shown[0].startswith("bad.yaml:4:1: wrong_0: no such option")
    assert shown[12] == "ibdata: and 3 more"


@pytest.mark.parametrize(
    ("config", "message", "file", "line"),
    [
        ("ranom", "did you mean 'random'?", None, None),
        ("bad.yaml", "steps: found 0, expected", "bad.yaml", 4),
    ],
)
def test_an_error_is_json_too_when_asked_for(ibdata, tmp_path, config, message, file, line):
    (tmp_path / "bad.yaml").write_text("name: bad\nsetpoints: [50]\npolicies: [{kind: random}]\nsteps: 0\n")
    error = json.loads(ibdata("generate", "--config", config, "--json").stdout)["error"]
    assert (error["code"], error["file"], error["line"]) == (2, file, line)
    assert message in error["message"]


def test_a_shipped_suite_is_made_in_a_folder_of_its_name(ibdata, tmp_path):
    tiny = ("--set", "episodes=1", "--set", "steps=3", "--workers", "1")
    done = ibdata("generate", "--config", "siemens-offline", *tiny, "--json")
    data = json.loads(done.stdout)
    assert (data["out"], data["rows"], len(data["datasets"])) == ("data/siemens-offline", 48, 16)
    assert data["datasets"][0]["name"] == "bad-0"
    assert (tmp_path / data["datasets"][0]["out"] / "meta/manifest.json").is_file()
    again = ibdata("generate", "--config", "siemens-offline", *tiny, "--resume")
    assert again.returncode == 0
    assert "16 in data/siemens-offline" in again.stdout
    assert data["datasets"][0]["content_root"] in again.stdout


def test_a_dry_run_of_a_suite_says_what_each_would_be_and_all(ibdata, tmp_path):
    tiny = ("--config", "siemens-offline", "--set", "steps=3", "--dry-run")
    data = json.loads(ibdata("generate", *tiny, "--out", "here", "--json").stdout)
    assert (data["out"], data["rows"], data["episodes"]) == ("here", 4800, 1600)
    assert [e["rows"] for e in data["experiments"]] == [300] * 16
    shown = ibdata("generate", *tiny).stdout
    assert "data/siemens-offline/bad-0: 300 rows, " in shown
    assert "rows      4,800" in shown
    assert list(tmp_path.iterdir()) == []
