"""`ibdata info`, `head`, `stats` and `config`, and rules for all commands."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from ibdata import Experiment

pytestmark = pytest.mark.slow

REPORTS = [
    ("info", "DATA"),
    ("head", "DATA"),
    ("stats", "DATA"),
    ("config", "validate", "random"),
    ("config", "show", "random"),
]


@pytest.fixture(scope="module")
def data(command: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reports")
    subprocess.run(
        [command, "generate", "--config", "transfer", "--set", "steps=30", "--out", "made"],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    return folder / "made"


@pytest.mark.parametrize("report", REPORTS, ids=" ".join)
def test_every_report_is_text_or_one_json_document(ibdata, data, report):
    args = [str(data) if arg == "DATA" else arg for arg in report]
    text, document = ibdata(*args), ibdata(*args, "--json")
    assert (text.returncode, document.returncode) == (0, 0)
    assert text.stdout.strip()
    assert json.loads(document.stdout)["version"] == 1
    assert text.stderr == document.stderr == ""


def test_info_names_counts_splits_columns_and_the_content_root(ibdata, data):
    text = ibdata("info", str(data)).stdout
    document = json.loads(ibdata("info", str(data), "--json").stdout)
    assert "600 in 20 episodes of 30 steps" in text
    assert "split target  60 rows in 2 episodes" in " ".join(text.split()).replace("target 60", "target  60")
    assert document["content_root"] in text
    assert document["info"]["counts"]["rows"] == 600


def test_head_prints_the_columns_and_split_asked_for(ibdata, data):
    args = ("head", str(data), "-n", "2", "--columns", "step,obs_setpoint", "--split", "target")
    assert json.loads(ibdata(*args, "--json").stdout)["rows"] == [
        {"step": 0, "obs_setpoint": 75.0},
        {"step": 1, "obs_setpoint": 75.0},
    ]
    assert ibdata(*args).stdout.split() == ["step", "0", "1", "obs_setpoint", "75", "75"]


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        (("info", "safe"), 3, "; ibdata generate safe makes data/safe"),
        (
            ("stats", "data/neorl-like"),
            3,
            "; ibdata generate neorl-like makes the datasets of data/neorl-like",
        ),
        (("stats", "d4rl-like/medium"), 3, "; ibdata generate d4rl-like/medium makes data/d4rl-like/"),
        (("info", "nowhere"), 3, "nowhere: no finished dataset here: meta/manifest.json is missing"),
        (("head", "DATA", "--columns", "nope"), 2, "column: found 'nope', expected one of episode, step"),
        (("head", "DATA", "--split", "nope"), 2, "split: found 'nope', expected one of source, target"),
        (("stats", "DATA", "--split", "nope"), 2, "split: found 'nope', expected one of source, target"),
        (("head", "DATA", "-n", "0"), 2, "Invalid value for '--rows'"),
        (("nonsense",), 2, "No such command 'nonsense'."),
        (("config", "validate", "nope"), 2, "config: found 'nope', expected a file or one of cautious"),
    ],
)
def test_a_wrong_call_gives_a_line_and_a_stable_code(ibdata, data, args, code, message):
    done = ibdata(*(str(data) if arg == "DATA" else arg for arg in args))
    assert done.returncode == code
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_debug_adds_the_traceback(ibdata):
    done = ibdata("info", "nowhere", "--debug")
    assert done.returncode == 3
    assert "Traceback" in done.stderr


def test_config_schema_is_that_of_experiments(ibdata):
    assert json.loads(ibdata("config", "schema").stdout) == Experiment.model_json_schema()


@pytest.mark.parametrize(
    "args", [(), ("generate",), ("info",), ("head",), ("stats",), ("export",), ("config", "show")]
)
def test_every_command_has_help_that_imports_nothing_heavy(ibdata, command, args):
    done = ibdata(*args, "-h")
    assert done.returncode == 0
    assert done.stdout == ibdata(*args, "--help").stdout
    code = (
        "import sys\nfrom ibdata.cli import main\ntry:\n    main(sys.argv[1:])\nexcept SystemExit:\n"
        "    print([m for m in ('numpy', 'numba', 'pandas', 'pyarrow', 'pydantic') if m in sys.modules])"
    )
    python = Path(command).parent / "python"
    heavy = subprocess.run([python, "-c", code, *args, "-h"], capture_output=True, text=True, check=True)
    assert heavy.stdout.splitlines()[-1] == "[]"


def test_version_is_printed(ibdata):
    assert ibdata("--version").stdout == "ibdata, version 0.9.0\n"


def test_a_closed_stdout_is_no_traceback(command, data):
    done = subprocess.run(
        f"{command} head {data} -n 200 | head -n 1", shell=True, capture_output=True, text=True
    )
    assert "Traceback" not in done.stderr
    assert "Exception" not in done.stderr
