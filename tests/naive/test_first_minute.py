"""What people do with their first commands, which make few rows in plain Python while nothing is compiled."""

import fcntl
import json
import os
import signal
import struct
import subprocess
import termios
from pathlib import Path

import pytest

import ibdata
from ibdata._system import processes
from ibdata.cli import cli
from ibdata.errors import UsageError
from ibdata.generation import small_work

MINE = "name: mine\nsetpoints: [20, 70]\npolicies: [random, safe]\nepisodes: 2\nsteps: 10\n"
MINE += "output: {shard_rows: 40}\n"  # two shards


@pytest.fixture
def commands(tmp_path, monkeypatch):
    """A function that runs a line in a folder with mine.yaml: whether it makes its rows in plain Python."""
    asked = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(processes, "purpose", "command")
    monkeypatch.setattr(small_work, "uncompiled", lambda function: tmp_path / "rows")
    monkeypatch.setattr(small_work, "interpret", lambda: asked.append(1))
    for name in small_work.MODE_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    Path("mine.yaml").write_text(MINE)

    def run(line):
        asked.clear()
        cli.main(line.split(), standalone_mode=False)
        return bool(asked)

    return run


@pytest.fixture
def right(tmp_path):
    return ibdata.generate(tmp_path / "mine.yaml", tmp_path / "right").content_root


def test_a_first_command_is_run_twice(commands, capsys):
    """The second finds the dataset, announces no rows and counts none."""
    assert commands("generate mine.yaml")
    rows = os.path.getsize("rows")
    capsys.readouterr()
    assert not commands("generate mine.yaml")
    assert os.path.getsize("rows") == rows == 80
    assert capsys.readouterr().err == "ibdata: data/mine: already there; nothing was written\n"


def test_a_folder_of_experiments_is_one_piece_of_work(commands):
    """Two experiments of 15,000 rows are worth compiling, and two small ones are not."""
    Path("both").mkdir()
    for name in ("a", "b"):
        Path("both", f"{name}.yaml").write_text(f"name: {name}\nsetpoints: 50\npolicies: [safe]\nsteps: 10\n")
    assert not commands("generate both --set steps=15000 --out large")
    assert commands("generate both")
    assert os.path.getsize("rows") == 20


def test_the_shards_of_a_first_dataset_are_made_one_after_the_other(commands, right):
    """Each command makes its own; nothing of `finalize` is compiled or interpreted."""
    assert commands("generate mine.yaml --out x --shards 1/2")
    assert commands("generate mine.yaml --out x --shards 2/2")
    assert not commands("finalize x")
    assert ibdata.open("x").content_root == right


def test_a_first_dataset_has_a_url(commands, right):
    """It is new, or it is there, as in a folder."""
    line = f"generate mine.yaml --out {Path.cwd().as_uri()}/x"
    assert [commands(line), commands(line)] == [True, False]
    assert ibdata.open("x").content_root == right


def test_a_loop_over_seeds_is_compiled_when_that_is_worth_it(commands):
    """Of commands that make 80 rows each, the one that would pass the break-even compiles, and later ones."""
    Path("rows").write_bytes(bytes(small_work.ENOUGH - 100))
    assert [commands(f"generate mine.yaml --seed {i} --out {i}") for i in range(3)] == [True, False, False]


def test_a_job_that_warms_the_cache_compiles_a_few_rows(commands, monkeypatch):
    """With `IBDATA_COMPILE=1`, whatever is to be made."""
    monkeypatch.setenv("IBDATA_COMPILE", "1")
    assert not commands("generate mine.yaml")
    assert not Path("rows").exists()


def test_a_first_call_in_a_notebook_compiles(commands, monkeypatch, capsys):
    """It is one of many in its process."""
    monkeypatch.setattr(processes, "purpose", "session")
    ibdata.generate("mine.yaml")
    assert not Path("rows").exists()
    assert "plain Python" not in capsys.readouterr().err


def test_a_file_of_a_policy_is_missing(commands):
    """That is said with the others' faults and its place in the file, and before consent to its code."""
    Path("mine.yaml").write_text(MINE.replace("safe", "{kind: custom, target: 'own.py:Mine'}"))
    with pytest.raises(
        UsageError, match=r"^mine\.yaml:3:43: policies\.1\.target: found no file 'own\.py', exp"
    ):
        commands("generate mine.yaml")
    Path("own.py").touch()
    with pytest.raises(UsageError, match=r"(--allow-code|allow_code=True) if you trust it"):
        commands("generate mine.yaml")


def test_an_object_s_kind_is_no_kind_to_name():
    """`live` is what ibdata calls an object in a record, so no list of kinds has it."""
    for name in ("live", "liv"):
        with pytest.raises(UsageError, match=f"found '{name}', expected one of bad, .* gaussian, mediocre, "):
            ibdata.evaluate(name)


def test_what_a_first_cell_shows_is_a_page(tmp_path):
    """`ds.info` is a dict that shows as tables; a return stands near a row's beginning."""
    more = {"dynamics": {"base": "paper", "eta_mean": 0.3}, "start": {"burn_in": [1, 2]}}
    plain = {"name": "x", "setpoints": 50, "policies": ["safe"], "steps": 3, **more}
    ds = ibdata.generate(plain, tmp_path / "x")
    page = repr(ds.info).splitlines()
    assert len(page) < 60
    assert {"rows 3", "episodes 1"} < {" ".join(line.split()) for line in page}
    assert any("eta_mean" in line for line in page)
    assert ds.info._repr_html_().count("<table>") == 2
    assert json.loads(json.dumps(ds.info)) == json.loads((ds.path / "meta/dataset.json").read_bytes())
    assert [*ds.episodes][:7] == ["episode", "setpoint", "policy", "acting", "splits", "length", "return"]
    assert "mean_return" in [*ibdata.baselines()][:10]  # of which pandas shows the first and the last ten


@pytest.fixture
def environment(tmp_path, monkeypatch):
    """The variables of a shell in a folder with mine.yaml and an empty cache."""
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text(MINE)
    kept = {k: v for k, v in os.environ.items() if k not in small_work.MODE_VARIABLES}
    return kept | {"IBDATA_CACHE_DIR": str(tmp_path / "cache")}


def test_ctrl_c_ends_a_first_command_while_its_bar_moves(command, environment):
    """Its rows are one piece of work of three seconds, and the bar shows each tenth of one."""
    ours, theirs = os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 100, 0, 0))
    process = subprocess.Popen([command, "generate", "random"], stderr=theirs, env=environment)
    os.close(theirs)
    said = ""
    try:
        while "%|" not in said or " 0%|" in said.rpartition("\r")[2]:
            said += os.read(ours, 4096).decode()
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130
        said += os.read(ours, 65536).decode()
    finally:
        process.kill()
        os.close(ours)
    assert "in plain Python" in said
    assert "100%" not in said
    assert not Path("data").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    "lines",
    [
        "$ibdata generate mine.yaml --out x --workers 2",
        "cat mine.yaml | $ibdata generate /dev/stdin --out x",
        "$ibdata generate <(cat mine.yaml) --out x",
        "for i in 1 2; do $ibdata generate mine.yaml --out x --shards $i/2; done; $ibdata finalize x",
    ],
    ids=["workers", "stdin", "pipe", "shards"],
)
def test_a_first_command_makes_the_same_rows_however_it_is_given(command, environment, right, lines):
    """In processes, from a pipe that can be read once, or in parts: without the compiler, to the bit."""
    shell = ["bash", "-ec", lines.replace("$ibdata", command)]
    subprocess.run(shell, env=environment, check=True, capture_output=True)
    assert not list(Path("cache").rglob("*.nbc"))
    assert ibdata.open("x").content_root == right
