"""The commands of the first minutes: init, policies, help, completion."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import ibdata
from ibdata.cli import cli
from ibdata.experiment.template import template
from ibdata.plots import names, plots
from ibdata.policies import POLICIES

pytestmark = pytest.mark.slow

IBDATA = str(Path(sys.executable).with_name("ibdata"))
COMMANDS = cli.list_commands(None)


def test_init_writes_a_valid_experiment_named_as_the_file(run, tmp_path):
    code, out, _ = run("init", "mine.yaml")
    assert (code, out) == (0, "mine.yaml: edit it, then run ibdata generate mine.yaml --dry-run\n")
    experiment = ibdata.load(tmp_path / "mine.yaml")
    assert experiment.name == "mine"
    assert set(experiment.splits) == {"source", "target"}
    assert (
        ibdata.generate(experiment, tmp_path / "out", workers=1, overrides=()).info["counts"]["episodes"]
        == 40
    )


def test_the_template_shows_every_option():
    """All but the version of the format, and the size of files."""
    plain = set(ibdata.Experiment.model_fields) - {"version"}
    assert {key for key in plain if f"\n{key}:" in template("x")} == plain


def test_init_leaves_a_file_that_is_there(run, tmp_path):
    (tmp_path / "experiment.yaml").write_text("mine")
    assert run("init")[::2] == (2, "experiment.yaml: exists already; choose another name\n")
    assert (tmp_path / "experiment.yaml").read_text() == "mine"
    code, _, err = run("init", "nowhere/x.yaml")
    assert (code, err) == (1, "nowhere/x.yaml: cannot be written: No such file or directory\n")


@pytest.mark.parametrize("name", ["x y.yaml", "con", "ÄÖ.yaml", "a.b.yaml", "CAPITAL.yaml"])
def test_a_file_name_that_names_no_experiment_gives_another_name(run, tmp_path, name):
    run("init", name)
    assert ibdata.load(tmp_path / name).name in ("experiment", name)


def test_policies_lists_every_kind_and_option(run):
    _, out, _ = run("config", "policies")
    _, as_json, _ = run("config", "policies", "--json")
    listed = {policy["kind"]: policy for policy in json.loads(as_json)["policies"]}
    assert set(listed) == set(POLICIES)
    for kind, policy in POLICIES.items():
        assert f"{kind}: " in out
        options = [option["name"] for option in listed[kind]["options"]]
        assert options == [name for name in policy.model_fields if name not in ("kind", "name")]
        assert all(f"    {name} (" in out for name in options)
        assert all(option["description"] for option in listed[kind]["options"])


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_examples_of_the_command_itself(run, name):
    code, out, _ = run(name, "--help")
    assert code == 0
    assert f"  ibdata {name}" in out.replace("Usage: ibdata", "")


@pytest.mark.parametrize(("name", "listed"), [("figure", names), ("plot", plots)])
def test_help_lists_every_picture(run, name, listed):
    _, out, _ = run(name, "--help")
    assert all(f"\n  {each} " in out for each in listed())


def test_a_removed_current_folder_is_named(tmp_path):
    leave = "import os, sys; os.mkdir('gone'); os.chdir('gone'); os.rmdir('../gone'); "
    leave += f"os.execv({IBDATA!r}, [{IBDATA!r}, 'generate', '--config', 'random.yaml'])"
    done = subprocess.run([sys.executable, "-c", leave], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "ibdata: the current folder: No such file or directory\n"


def test_python_m_ibdata_is_the_command():
    done = subprocess.run([sys.executable, "-m", "ibdata", "--version"], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == (f"ibdata, version {ibdata.__version__}\n", "")
