"""What a run leaves behind that a misbehaving policy ends."""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from helpers.odd import PLAIN, STEPS, good

import ibdata
from ibdata import Experiment
from ibdata.cli import main
from ibdata.errors import PolicyError
from ibdata.policies import Decision, Needs, Policy
from ibdata.policies.random import Random
from ibdata.validation.validate import validate

pytestmark = pytest.mark.corpus


@pytest.fixture
def generated(monkeypatch, tmp_path):
    """Generate into out where the random policy answers so, given how often it has been asked."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Random, "needs", Needs(history=1, step_draws=3))
    monkeypatch.setattr("ibdata.generation.workers.available_processors", lambda: 1)  # shards in order
    monkeypatch.setattr("ibdata.experiment.self_check.answer", lambda: "0" * 64)  # it plays this policy too

    def generate(answer, resume=False):
        calls = itertools.count()

        def decide(self, given):
            return Decision(answer(given.observations, given.uniforms, next(calls)), given.memory)

        monkeypatch.setattr(Random, "decide", decide)
        experiment = Experiment.model_validate(PLAIN)
        return ibdata.generate(experiment, "out", workers=1, resume=resume)

    return generate


@pytest.mark.parametrize("asked", [0, 1, 2, 7, 8, 8 + STEPS, 1 + 4 * STEPS])
@pytest.mark.parametrize("bad", [lambda a: np.full_like(a, np.nan), lambda a: a[0]], ids=["NaN", "shape"])
def test_a_run_that_a_policy_ends_can_be_resumed(generated, bad, asked):
    """The warm-up asks twice, and a shard once a step."""

    def answer(history, u, call):
        return bad(good(history, u)) if call >= asked else good(history, u)

    with pytest.raises(PolicyError, match=r"^policy random: episode \d: step \d: found action"):
        generated(answer)
    assert not Path("out").exists()
    assert Path(".out.part").exists() == (asked >= 2 + STEPS)
    assert not [*Path().rglob("*manifest.json"), *Path().rglob(".tmp-*")]
    assert generated(lambda h, u, call: good(h, u), resume=True).manifest["rows"] == 4 * STEPS
    assert validate(Path("out")) == []
    assert os.listdir() == ["out"]


def test_clipped_actions_are_counted_in_the_manifest(generated):
    made = generated(lambda h, u, call: np.full((len(h), 3), 1e308))
    assert made.manifest["clipped_actions"] == len(made) == 24


def test_a_dataset_without_densities_is_shown_by_every_command(generated, monkeypatch, capsys):
    monkeypatch.setattr("ibdata.cli._end_at_signals", lambda: None)  # the tests have handlers of their own
    monkeypatch.setattr(Random, "log_density", Policy.log_density)
    generated(lambda h, u, call: good(h, u))
    capsys.readouterr()  # without this density, the known run of this machine has other bits
    for command in (["info"], ["stats"], ["head"], ["validate"], ["head", "--json"], ["stats", "--json"]):
        with pytest.raises(SystemExit) as end:
            main([*command, "out"])
        shown = capsys.readouterr()
        assert (end.value.code or 0, shown.err) == (0, ""), command
        if "--json" in command:
            json.loads(shown.out, parse_constant=pytest.fail)


SCRIPT = """
    import os
    import ibdata

    experiment = ibdata.Experiment.model_validate({plain})
    try:
        ibdata.generate(experiment, "out", workers=2, allow_code=True)
    except ibdata.IbdataError as error:
        print(error)
    print(sorted(os.listdir()))
"""
ENDING = """
    import os, sys

    class Ending:
        def act(self, history, u):
            if sys.argv[0] == "-c":  # in a worker
                os._exit(7)
            return 2.0 * u - 1.0
"""


def test_a_policy_that_ends_its_workers_leaves_nothing(tmp_path):
    script = tmp_path / "script.py"
    policy = {"kind": "custom", "target": "ending:Ending", "uniforms": 3}
    script.write_text(textwrap.dedent(SCRIPT).format(plain={**PLAIN, "policies": [policy]}))
    (tmp_path / "ending.py").write_text(textwrap.dedent(ENDING))
    done = subprocess.run(
        [sys.executable, "-B", "-W", "error", script],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
    )
    line, left = done.stdout.splitlines()
    assert line == (
        "a worker process ended with code 7, perhaps for lack of memory; run again with --resume and "
        "fewer --workers"
    )
    assert left == "['ending.py', 'script.py']"
    assert done.stderr == "ibdata: running the code of ending:Ending\n"
