"""Custom policies of one file and of several, and runs with them."""

from __future__ import annotations

import hashlib
import json
import textwrap
from pathlib import Path

import pytest

import ibdata
from helpers.folders import receipts
from ibdata import Experiment
from ibdata.errors import IbdataError

# A policy of several files, whose run stops in the third of four shards while `at-70-stop.py` is there.
PLAIN = {
    "name": "own",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "custom", "target": "mine:Own", "draws": 3, "files": ["weights.txt"]}],
    "episodes": 2,
    "steps": 4,
    "output": {"shard_rows": 4},
}
FILES = {
    "mine.py": """
        import pathlib
        import helper

        class Own:
            def __init__(self):
                self.size = float(pathlib.Path("weights.txt").read_text())

            def act(self, history, u):
                from lazy import SIGN
                if history[0, 0, 0] == 70:
                    for path in pathlib.Path().glob("at-70-*.py"):
                        exec(path.read_text())
                return SIGN * helper.SIZE * self.size * (2.0 * u - 1.0)
        """,
    "helper.py": "SIZE = 0.25",
    "lazy.py": "SIGN = -1.0",
    "weights.txt": "0.5",
    "own.yaml": json.dumps(PLAIN),
    "at-70-stop.py": "raise RuntimeError('stopped')",
}
# A module `mine` with policies in each of the forms that a target takes.
CODE = textwrap.dedent("""
    import numpy as np

    open("imported", "w").close()

    class Actor:
        def __init__(self, gain=0.0):
            self.gain = gain

        def act(self, history, u):
            return self.gain * (2.0 * u - 1.0) + 0.001 * history[:, 0, 1:4]

    class Learned:
        def predict(self, observations):
            return np.tanh(observations[:, 7:10] / 100.0), None

    def made(value):
        return type("Still", (), {"predict": lambda self, x: np.full((len(x), 3), value)})()

    def still(observations, value=0.125):
        return np.full((len(observations), 3), value)

    def by_name(obs):
        return still(obs)

    actor = Actor(0.25)
    nothing = object()

    def failing():
        raise RuntimeError("no weights")

    calls = []

    def counting(observations):
        calls.append(0)
        return still(observations, len(calls) / 1000.0)
""")


def generate(out="out", **options):
    """The dataset of `own.yaml`."""
    return ibdata.generate("own.yaml", out, allow_code=True, **{"workers": 1, **options})


def stopped(out="out", **options):
    """A run that stops in the third of four shards."""
    with pytest.raises(IbdataError, match="RuntimeError: stopped"):
        generate(out, **options)
    Path("at-70-stop.py").unlink()
    assert len(receipts(out)) == 2


def sha256(path):
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def described(**policy):
    """An experiment with a custom policy of these options."""
    return Experiment.model_validate(
        {
            "name": "own",
            "setpoints": [20.0, 70.0],
            "policies": [{"kind": "custom", **policy}],
            "steps": 4,
            "output": {"shard_rows": 4},
        }
    )
