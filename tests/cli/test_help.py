"""Help, the lists of what there is, and the first file: init, policies, config."""

import json
import subprocess
import sys

import ibdata
from ibdata.cli import cli
from ibdata.experiment import shipped, suites
from ibdata.policies import POLICIES


def test_help_fits_a_terminal_and_has_examples(run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    of_config = (["config", name] for name in cli.get_command(None, "config").list_commands(None))
    for words in ([], *of_config, *([name] for name in cli.list_commands(None))):
        code, out, err = run(*words, "-h")
        assert (code, err) == (0, "")
        assert not [line for line in out.splitlines() if len(line) > 80]
        assert len(words) != 1 or f"  ibdata {' '.join(words)}" in out.replace("Usage: ibdata", "")


HEAVY = """
import sys
from ibdata.cli import main
for words in ([], ["generate"], ["info"], ["export"], ["config", "show"]):
    try:
        main([*words, "-h"])
    except SystemExit:
        print([m for m in ("numpy", "numba", "pandas", "pyarrow", "pydantic") if m in sys.modules])
"""


def test_help_and_ibdata_itself_import_nothing_heavy():
    done = subprocess.run([sys.executable, "-c", HEAVY], capture_output=True, text=True, check=True)
    assert [line for line in done.stdout.splitlines() if line.startswith("[")] == ["[]"] * 5


def test_policies_lists_every_kind_and_option(run):
    out = run("config", "policies")[1]
    listed = {each["kind"]: each for each in json.loads(run("config", "policies", "--json")[1])["policies"]}
    assert set(listed) == set(POLICIES)
    for kind, policy in POLICIES.items():
        assert f"{kind}: " in out
        options = [option["name"] for option in listed[kind]["options"]]
        assert options == [name for name in policy.model_fields if name not in ("kind", "name")]
        assert all(f"    {name} (" in out for name in options)
        assert all(option["description"] for option in listed[kind]["options"])


def test_configs_are_listed_with_rows_and_descriptions(run):
    code, out, _ = run("config", "list")
    lines = out.splitlines()
    assert (code, len(lines)) == (0, 1 + len(suites()) + len(shipped()))
    assert any(line.split()[:3] == ["siemens-offline/", "1,600,000", "A"] for line in lines)
    listed = json.loads(run("config", "list", "--json")[1])["configs"]
    assert {each["name"]: each["rows"] for each in listed}["transfer"] == 20_000


def test_init_writes_a_valid_experiment_named_as_the_file(run, tmp_path):
    said = "mine.yaml: edit it, then run ibdata generate --config mine.yaml --dry-run\n"
    assert run("init", "mine.yaml") == (0, said, "")
    experiment = ibdata.load(tmp_path / "mine.yaml")
    assert (experiment.name, set(experiment.splits)) == ("mine", {"source", "target"})
    assert run("init", "x y.yaml")[0] == 0  # which names no experiment
    assert ibdata.load(tmp_path / "x y.yaml").name == "experiment"
    assert run("init", "mine.yaml") == (2, "", "mine.yaml: exists already; choose another name\n")
