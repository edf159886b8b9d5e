"""In a folder of somebody else, commands and their workers take no configuration and no module from it."""

import os
import shlex
from itertools import groupby

import pytest

# What libraries look for in the current folder, or would if they were started in another way.
BAITS = (".numba_config.yaml", "matplotlibrc", "sitecustomize.py", "usercustomize.py", "numba.py", "yaml.py",
         "numpy.py", "ibdata.py", ".env", ".netrc", ".rayignore", "pyproject.toml", "setup.cfg", "site.cfg",
         "ipython_config.py", ".duckdbrc", "fsspec.json", "conf.yaml")  # fmt: skip
WATCH = """
import os, sys
log = os.open(os.environ["WATCH_LOG"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
folder = os.getcwd()
def watch(event, args):
    if event == "open" and isinstance(args[0], (str, bytes)):
        path = os.path.abspath(os.fsdecode(args[0]))
        if os.path.dirname(path) == folder:
            os.write(log, f"{os.getpid()} {os.path.basename(path)}\\n".encode())
sys.addaudithook(watch)
"""
PLAIN = """
name: x
setpoints: [10, 20]
policies: [random, safe]
episodes: 2
steps: 10
output: {shard_rows: 10}
splits: {low: {setpoint: 10}}
"""
CUSTOM = PLAIN.replace("safe", "{kind: custom, target: 'mine:act'}")
MINE = """
import numba

@numba.njit(cache=True)
def half(x):
    return 0.5 * x

def act(observations):
    return observations[:, :3] * half(0.01)
"""
COMMANDS = """
config validate x.yaml
generate --config x.yaml --out x
generate --config x.yaml --out y --seed 1 --shards 1/2
generate --config x.yaml --out y --seed 1 --shards 2/2
finalize y
info x
head x
stats x --quality
ls
validate x
repair x
reproduce x
evaluate random --setpoint 10 --episodes 2 --steps 5
card x --overwrite
split x --by policy
merge x y --out m
export x --to npz --out x.npz
init new
plot x --out pictures
"""


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "foreign"
    folder.mkdir()
    for name in BAITS:
        (folder / name).write_bytes(b"\xff\xfe: no text, no YAML, no Python\n")
    (folder / "x.yaml").write_text(PLAIN)
    return folder


@pytest.fixture
def opened(folder, ibdata, tmp_path):
    """A function that runs a command in the folder, and returns which files of it each process opened."""
    watched = tmp_path / "watched"
    watched.mkdir()
    (watched / "sitecustomize.py").write_text(WATCH)
    (watched / "yaml.py").write_text("def safe_load(file): return {}\n")  # without it, numba opens no file
    log = tmp_path / "log"
    env = {
        **os.environ,
        "PYTHONPATH": str(watched),
        "WATCH_LOG": str(log),
        "NUMBA_CACHE_LOCATOR_CLASSES": "a.b",
    }

    def run(line):
        log.write_text("")
        done = ibdata(*shlex.split(line), cwd=folder, env=env)
        assert done.returncode == 0, done.stderr
        assert "a bug of ibdata" not in done.stderr
        lines = sorted({line for line in log.read_text().splitlines()})
        return [
            {name.split()[1] for name in of_one} for _, of_one in groupby(lines, lambda line: line.split()[0])
        ]

    return run


@pytest.fixture(params=["compiled before", pytest.param("the first command", marks=pytest.mark.slow)])
def cache(request, tmp_path, monkeypatch):
    if request.param == "the first command":  # which is interpreted
        monkeypatch.setenv("IBDATA_CACHE_DIR", str(tmp_path / "cache"))


def test_a_run_takes_nothing_from_the_folder(cache, opened):
    (files,) = opened("generate --config x.yaml --out x")
    assert "x.yaml" in files
    assert not files & set(BAITS)


@pytest.mark.slow
def test_pictures_follow_no_configuration_of_matplotlib(folder, opened, ibdata, tmp_path):
    opened("generate --config x.yaml --out x")
    assert not set().union(*opened("plot x --out pictures")) & set(BAITS)
    (tmp_path / "matplotlibrc").write_text("image.lut: 4\nlines.linewidth: 9\n")
    env = {**os.environ, "MATPLOTLIBRC": str(tmp_path)}
    assert ibdata("plot", str(folder / "x"), "--out", "others", env=env, cwd=folder).returncode == 0
    pictures = {path.name: path.read_bytes() for path in (folder / "pictures").iterdir()}
    assert pictures == {path.name: path.read_bytes() for path in (folder / "others").iterdir()}
    (tmp_path / "matplotlibrc").write_bytes(b"\xff\xfe")
    refused = ibdata("plot", str(folder / "x"), "--out", "none", env=env, cwd=folder)
    assert refused.returncode == 1
    assert "matplotlib: cannot be imported: " in refused.stderr
    assert "a bug of ibdata" not in refused.stderr


@pytest.mark.slow
def test_workers_compile_custom_code_without_the_folders_configuration(folder, opened):
    for path in folder.glob("*.py"):  # with --allow-code they could be imported
        path.unlink()
    (folder / "mine.py").write_text(MINE)
    (folder / "x.yaml").write_text(CUSTOM)
    files = opened("generate --config x.yaml --out x --workers 2 --allow-code")
    assert sum("mine.py" in of_one for of_one in files) >= 2
    assert not set.union(*files) & set(BAITS)
    files = opened("evaluate '{kind: custom, target: mine:act}' --episodes 2 --steps 5")
    assert "mine.py" in set.union(*files)
    assert not set.union(*files) & set(BAITS)


@pytest.mark.slow
def test_every_command_leaves_the_files_of_the_folder_alone(opened):
    for line in COMMANDS.split("\n")[1:-1]:
        assert not set().union(*opened(line)) & set(BAITS), line
