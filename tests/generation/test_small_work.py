"""A first command makes few rows in plain Python: the same rows, and no wait for the compiler."""

import json
import os
import shutil

import pytest

import ibdata
from ibdata._numerics.compiled import FUNCTIONS
from ibdata._system import processes
from ibdata._system.configs import shipped
from ibdata.experiment import load
from ibdata.generation import small_work
from ibdata.plan.dataset_spec import DatasetSpec

EVERYTHING = """
name: {dynamics}
dynamics: {dynamics}
setpoints: {{drifting: [10, 90]}}
start: {{burn_in: [1, 3]}}
policies:
- random
- safe
- optimized
- {{kind: expert, dynamics: {dynamics}}}
- prbs
- bad
- {{kind: epsilon_greedy, base: mediocre, epsilon: 0.5}}
- {{kind: gaussian, base: constant, scale: 0.5}}
- {{kind: ornstein_uhlenbeck}}
- {{kind: sticky, base: random, kappa: 0.5}}
- {{kind: mixture, bases: [random, safe]}}
steps: 20
output: {{latent: full, shard_rows: 60}}
"""


@pytest.fixture
def first(ibdata, tmp_path):
    """A function that runs a command where nothing is compiled: its result, and the files of the cache."""
    cache = tmp_path / "cache"
    env = {k: v for k, v in os.environ.items() if k not in small_work.MODE_VARIABLES}
    env["IBDATA_CACHE_DIR"] = str(cache)

    def run(*line, **variables):
        done = ibdata(*line, "--json", env=env | variables)
        assert (done.returncode, done.stderr) == (0, "")  # no warning of numpy's either
        return json.loads(done.stdout), [path for path in cache.rglob("*") if path.is_file()]

    return run


def test_a_first_command_compiles_nothing_and_makes_the_same(first, tmp_path):
    """It counts the rows, with those of the burn-in."""
    (tmp_path / "x.yaml").write_text(EVERYTHING.format(dynamics="paper"))
    made, (file,) = first("generate", "x.yaml")
    assert file.suffix == ".rows"
    assert file.stat().st_size == 2 * 11 * (20 + 3)
    assert made["content_root"] == ibdata.generate(tmp_path / "x.yaml", tmp_path / "compiled").content_root


@pytest.mark.slow
def test_first_commands_make_the_same_rows_of_shipped_experiments(first, tmp_path):
    """The README's own at its size, the others small; workers compile nothing either."""
    made, files = first("generate", "random")
    assert made["content_root"].startswith("566ea3f2")
    folder = tmp_path / "x"
    folder.mkdir()
    (folder / "siemens.yaml").write_text(EVERYTHING.format(dynamics="siemens"))
    for name, file in shipped().items():
        if not any(any(load(file).everywhere(kind)) for kind in small_work.SLOW):
            shutil.copy(file, folder / f"{name.replace('/', '-')}.yaml")
    small = ("--set", "steps=20", "--set", "episodes=1", "--set", "splits={}")
    _, files = first("generate", "x", *small, "--workers", "2")
    assert [path.suffix for path in files] == [".rows"]
    roots = {
        name: dataset.content_root
        for name, dataset in ibdata.generate(folder, tmp_path / "compiled", overrides=small[1::2]).items()
    }
    assert len(roots) > 25
    assert roots == {name: ibdata.open(tmp_path / "data/x" / name).content_root for name in roots}


@pytest.mark.slow
def test_a_command_warms_the_cache(first):
    """As Containerfile does it. What is said of the number of functions is right."""
    line = ("generate", "random", "--set", "steps=10", "--out")
    _, files = first(*line, "x", IBDATA_COMPILE="1")
    assert abs(sum(path.suffix == ".nbc" for path in files) - FUNCTIONS) <= 3
    _, later = first(*line, "y")
    assert sorted(later) == sorted(files)


@pytest.fixture
def interprets(monkeypatch, tmp_path):
    """A function that tells whether a first command would interpret an experiment, and what it has said."""
    asked = []
    (tmp_path / "there").mkdir()
    (tmp_path / "there/file").touch()
    monkeypatch.setattr(processes, "purpose", "command")
    monkeypatch.setattr(small_work, "uncompiled", lambda function: tmp_path / "rows")
    monkeypatch.setattr(small_work, "interpret", lambda: asked.append(1))
    for name in small_work.MODE_VARIABLES:
        monkeypatch.delenv(name, raising=False)

    def run(place="absent", setpoints=10, policies=("random",), **options):
        experiment = load({"name": "x", "setpoints": setpoints, "policies": list(policies), **options})
        asked.clear()
        small_work.interpret_few_rows([DatasetSpec.of(experiment)], [tmp_path / place])
        return bool(asked)

    return run


@pytest.mark.parametrize(
    ("options", "right"),
    [
        ({"steps": 20_000}, True),
        ({"steps": 20_001}, False),
        ({"steps": 15_000, "start": {"burn_in": [0, 6_000]}}, False),
        ({"policies": ["random", {"kind": "network", "file": "all-1"}]}, False),
        ({"policies": [{"kind": "epsilon_greedy", "base": "multisine", "epsilon": 0.5}]}, False),
        ({"policies": [lambda observations: observations[:, :3]]}, False),
        ({"place": "there"}, False),
    ],
    ids=["few", "many", "burn-in", "network", "multisine", "custom", "already there"],
)
def test_few_rows_of_formulas_are_interpreted(interprets, options, right):
    assert interprets(**options) == right


@pytest.mark.parametrize("variable", ["IBDATA_COMPILE", "NUMBA_DISABLE_JIT"])
def test_a_variable_lets_every_command_compile(interprets, variable, monkeypatch):
    monkeypatch.setenv(variable, "0")
    assert not interprets()


def test_a_process_that_goes_on_compiles(interprets, monkeypatch):
    """As a notebook does, a script or a test."""
    monkeypatch.setattr(processes, "purpose", "session")
    assert not interprets()


def test_a_loop_of_small_commands_is_compiled_in_the_end(interprets, capsys, tmp_path):
    """Rows are counted until compiling them had been worth it."""
    assert [interprets(steps=15_000) for _ in range(4)] == [True, True, False, False]
    assert (tmp_path / "rows").stat().st_size == 30_000
    assert interprets(steps=10_000)
    said = "ibdata: 15,000 rows in plain Python, about 6 seconds; nothing is compiled for so few\n"
    assert capsys.readouterr().err.startswith(2 * said)


def test_a_cache_that_cannot_be_written_to_compiles(interprets, tmp_path):
    (tmp_path / "rows").mkdir()
    assert not interprets()
